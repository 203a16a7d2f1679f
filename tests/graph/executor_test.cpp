#include "graph/executor.h"

#include <gtest/gtest.h>
#include <oneapi/tbb/parallel_for.h>

#include <atomic>
#include <mutex>
#include <random>
#include <set>
#include <thread>

#include "graph/error.h"
#include "kernels/parallel.h"

namespace knead {
namespace executor_test {

std::vector<std::unique_ptr<Executor>> executors() {
  std::vector<std::unique_ptr<Executor>> all;
  all.push_back(make_serial_executor());
  for (const int threads : {1, 2, 3}) all.push_back(make_cpu_executor(threads));
  return all;
}

TEST(Executor, CutsTheSamePiecesForAnyNumberOfThreads) {
  for (const size_t n : {0, 1, 99, 100, 101, 1000}) {
    std::vector<std::set<std::pair<size_t, size_t>>> pieces;
    for (const auto& executor : executors()) {
      std::mutex mutex;
      std::set<std::pair<size_t, size_t>> mine;
      executor->parallel_ranges(n, 100, [&](size_t begin, size_t end) {
        std::lock_guard lock(mutex);
        EXPECT_TRUE(mine.emplace(begin, end).second);
      });
      pieces.push_back(mine);
      EXPECT_EQ(mine, pieces.front()) << executor->name() << " n " << n;
      EXPECT_EQ(mine.size(), (n + 99) / 100);
    }
  }
}

TEST(Executor, TakesAGrainOfZeroForOne) {
  for (const auto& executor : executors()) {
    std::atomic<int> calls{0};
    executor->parallel_ranges(5, 0, [&](size_t begin, size_t end) { calls += static_cast<int>(end - begin); });
    EXPECT_EQ(calls, 5);
  }
}

TEST(Executor, BringsExceptionsOutAndWorksOn) {
  for (const auto& executor : executors()) {
    EXPECT_THROW(executor->parallel_ranges(1000, 1,
                                           [](size_t begin, size_t) {
                                             if (begin == 500) throw Error(ErrorCode::kInput, "here");
                                           }),
                 Error);
    EXPECT_THROW(executor->run_graph({{1}, {2}, {}}, {0, 1, 1},
                                     [](int i) {
                                       if (i == 1) throw Error(ErrorCode::kInput, "here");
                                     }),
                 Error);
    std::atomic<int> calls{0};
    executor->parallel_ranges(100, 1, [&](size_t, size_t) { ++calls; });
    executor->run_graph({{}, {}}, {0, 0}, [&](int) { ++calls; });
    EXPECT_EQ(calls, 102);
  }
}

TEST(Executor, RunsATaskAfterAllThatItWaitsFor) {
  std::mt19937 random(1);
  constexpr int n = 200;
  std::vector<std::vector<int>> successors(n);
  std::vector<int> waits_for(n);
  for (int i = 1; i < n; ++i)
    for (int k = 0; k < 3; ++k) {
      const int before = static_cast<int>(random() % static_cast<unsigned>(i));
      successors[static_cast<size_t>(before)].push_back(i);
      ++waits_for[static_cast<size_t>(i)];
    }
  for (const auto& executor : executors()) {
    std::vector<std::atomic<int>> arrived(n);
    std::atomic<int> ran{0};
    executor->run_graph(successors, waits_for, [&](int i) {
      EXPECT_EQ(arrived[static_cast<size_t>(i)], waits_for[static_cast<size_t>(i)]);
      for (const int next : successors[static_cast<size_t>(i)]) ++arrived[static_cast<size_t>(next)];
      ++ran;
    });
    EXPECT_EQ(ran, n);
  }
}

TEST(Executor, NestsLoopsInLoopsInGraphs) {
  for (const auto& executor : executors()) {
    std::atomic<int> calls{0};
    executor->run_graph(std::vector<std::vector<int>>(8), std::vector<int>(8), [&](int) {
      executor->run_graph({{1}, {}}, {0, 1}, [&](int) {
        executor->parallel_ranges(10, 1, [&](size_t, size_t) { executor->parallel_ranges(10, 1, [&](size_t, size_t) { ++calls; }); });
      });
    });
    EXPECT_EQ(calls, 8 * 2 * 100);
  }
}

// As OpenVDB does inside a node: TBB of its own, while other tasks wait for a lock that this one holds.
TEST(Executor, NestsForeignTbbInTasksWithoutDeadlock) {
  for (const auto& executor : executors()) {
    std::mutex mutex;
    std::atomic<int> calls{0}, spins{0};
    for (int pass = 0; pass < 20; ++pass)
      executor->run_graph(std::vector<std::vector<int>>(16), std::vector<int>(16), [&](int) {
        std::lock_guard lock(mutex);  // a thread that took another of these tasks while it waits would lock it twice
        tbb::parallel_for(0, 64, [&](int) {
          for (int spin = 0; spin < 100; ++spin) ++spins;
          ++calls;
        });
        executor->parallel_ranges(64, 1, [&](size_t, size_t) { ++calls; });
      });
    EXPECT_EQ(calls, 20 * 16 * 128);
  }
}

TEST(Executor, ServesSeveralHostThreadsAtOnce) {
  for (const auto& executor : executors()) {
    std::atomic<int> calls{0};
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t)
      threads.emplace_back([&] {
        for (int i = 0; i < 50; ++i)
          executor->run_graph({{1}, {}}, {0, 1}, [&](int) { executor->parallel_ranges(32, 1, [&](size_t, size_t) { ++calls; }); });
      });
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(calls, 4 * 50 * 2 * 32);
  }
}

TEST(Executor, ReducesToTheSameBitsForAnyNumberOfThreads) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> any(-1, 1);
  std::vector<float> values(300001);
  for (float& value : values) value = any(random) * std::exp(10 * any(random));
  for (const size_t n : {size_t{0}, size_t{1}, size_t{511}, size_t{513}, size_t{131073}, values.size()}) {
    const auto all = executors();
    const float sum = reduce_sum(*all[0], n, "sum", [&](uint32_t i) { return values[i]; });
    const float most = reduce_max(*all[0], n, "max", [&](uint32_t i) { return values[i]; });
    for (const auto& executor : all)
      for (int again = 0; again < 5; ++again) {
        EXPECT_EQ(reduce_sum(*executor, n, "sum", [&](uint32_t i) { return values[i]; }), sum) << executor->name() << executor->threads();
        EXPECT_EQ(reduce_max(*executor, n, "max", [&](uint32_t i) { return values[i]; }), most);
      }
  }
}

TEST(Executor, HostExecutorsRefuseOtherDevicesMemory) {
  for (const auto& executor : executors()) {
    int from = 1, to = 0;
    executor->copy(&from, {}, &to, {}, sizeof from);
    EXPECT_EQ(to, 1);
    EXPECT_THROW(executor->copy(&from, {}, &to, {DeviceKind::kFake, 0}, sizeof from), Error);
    EXPECT_THROW(executor->copy(&from, {DeviceKind::kCuda, 0}, &to, {}, sizeof from), Error);
  }
}

TEST(Executor, SaysHowManyThreadsItHas) {
  EXPECT_EQ(make_serial_executor()->threads(), 1);
  EXPECT_EQ(make_cpu_executor(1)->threads(), 1);
  EXPECT_GE(make_cpu_executor()->threads(), 1);
  EXPECT_EQ(make_cpu_executor(100000)->threads(), make_cpu_executor()->threads());
}

}  // namespace executor_test
}  // namespace knead
