#include "graph/cancel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "graph/error.h"

namespace knead {
namespace cancel_test {

void wait(int milliseconds) {
  std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
}

// The pieces of a loop of 100 that run when the answer is yes after so many.
size_t pieces_run(Executor& executor, size_t before_yes) {
  std::atomic<size_t> pieces{0};
  const auto asked = [&] { return pieces >= before_yes; };
  const Cancellation cancellation(asked);
  const CancellationScope scope(&cancellation);
  try {
    executor.parallel_ranges(100, 1, [&](size_t, size_t) {
      ++pieces;
      wait(3);
    });
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kCancelled);
    EXPECT_LT(pieces, 100u);
    return pieces;
  }
  EXPECT_EQ(pieces, 100u);
  return pieces;
}

TEST(Cancel, EndsALoopBetweenItsPieces) {
  const auto serial = make_serial_executor(), cpu = make_cpu_executor(2), one = make_cpu_executor(1);
  for (Executor* executor : {serial.get(), cpu.get(), one.get()}) {
    EXPECT_GE(pieces_run(*executor, 5), 5u) << executor->name();
    EXPECT_LT(pieces_run(*executor, 5), 20u) << executor->name();
    EXPECT_EQ(pieces_run(*executor, 1000), 100u) << executor->name();
  }
}

TEST(Cancel, ReachesLoopsInsideOfLoops) {
  const auto cpu = make_cpu_executor(2);
  std::atomic<size_t> inner{0};
  const auto asked = [&] { return inner > 4; };
  const Cancellation cancellation(asked);
  const CancellationScope scope(&cancellation);
  const auto all = [&] {
    cpu->parallel_ranges(2, 1, [&](size_t, size_t) {
      cpu->parallel_ranges(100, 1, [&](size_t, size_t) {
        ++inner;
        wait(3);
      });
    });
  };
  EXPECT_THROW(all(), Error);
  EXPECT_LT(inner, 40u);
}

TEST(Cancel, AsksNobodyOutsideOfAScope) {
  EXPECT_NO_THROW(check_cancelled());
  const auto yes = [] { return true; };
  const Cancellation cancellation(yes);
  {
    const CancellationScope scope(&cancellation);
    EXPECT_THROW(check_cancelled(), Error);
    const CancellationScope nobody(nullptr);
    EXPECT_NO_THROW(check_cancelled());
  }
  EXPECT_NO_THROW(check_cancelled());
}

TEST(Cancel, AsksSeldomAndRemembersAYes) {
  int asked = 0;
  const auto answer = [&] { return ++asked == 2; };
  const Cancellation cancellation(answer);
  for (int i = 0; i < 1000; ++i) cancellation();
  EXPECT_LT(asked, 500) << "a host may take a lock to answer";
  wait(3);
  for (int i = 0; i < 3; ++i) wait(3), cancellation();
  const int before = asked;
  wait(3);
  EXPECT_TRUE(cancellation());
  EXPECT_EQ(asked, before) << "and it is not taken back";
}

}  // namespace cancel_test
}  // namespace knead
