#include "graph/cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "tests/graph/toys.h"

namespace knead {
namespace cache_test {

Key key_of(int i) {
  return Hasher().add(i).key();
}
Cache::Result result_of(double value, size_t size = 1) {
  return {{Value::of(toys::numbers(value, host_memory(), size))}, {"warned"}};
}
double value_in(const Cache::Result& result) {
  return toys::first(result.outputs.at(0).as<toys::Numbers>());
}

TEST(Cache, KeepsWhatIsStoredAndCounts) {
  Cache cache;
  Cache::Result result;
  EXPECT_FALSE(cache.find(key_of(1), result));
  cache.store(key_of(1), result_of(7));
  ASSERT_TRUE(cache.find(key_of(1), result));
  EXPECT_EQ(value_in(result), 7);
  EXPECT_EQ(result.warnings, std::vector<std::string>{"warned"});
  EXPECT_FALSE(cache.find(key_of(2), result));
  const CacheFigures figures = cache.figures();
  EXPECT_EQ(figures.hits, 1u);
  EXPECT_EQ(figures.misses, 2u);
  EXPECT_EQ(figures.entries, 1u);
  EXPECT_GE(figures.bytes, sizeof(double));
  cache.clear();
  EXPECT_FALSE(cache.find(key_of(1), result));
  EXPECT_EQ(cache.figures().bytes, 0u);
}

TEST(Cache, KeepsTheFirstOfTwoResultsForAKey) {
  Cache cache;
  cache.store(key_of(1), result_of(7));
  cache.store(key_of(1), result_of(8));
  Cache::Result result;
  ASSERT_TRUE(cache.find(key_of(1), result));
  EXPECT_EQ(value_in(result), 7);
  EXPECT_EQ(cache.figures().entries, 1u);
}

TEST(Cache, LetsTheLeastRecentlyUsedGoFirst) {
  Cache cache(10000);
  Cache::Result result;
  for (int i = 0; i < 3; ++i) cache.store(key_of(i), result_of(i, 300));  // three of 2400 bytes and some
  EXPECT_TRUE(cache.find(key_of(0), result));
  cache.store(key_of(3), result_of(3, 300));
  EXPECT_TRUE(cache.find(key_of(0), result));
  EXPECT_FALSE(cache.find(key_of(1), result));
  EXPECT_TRUE(cache.find(key_of(2), result));
  EXPECT_TRUE(cache.find(key_of(3), result));
  EXPECT_EQ(cache.figures().evictions, 1u);
  EXPECT_LE(cache.figures().bytes, 10000u);
}

TEST(Cache, DoesNotKeepWhatIsLargerThanItself) {
  Cache cache(10000);
  cache.store(key_of(1), result_of(1, 300));
  cache.store(key_of(2), result_of(2, 3000));
  Cache::Result result;
  EXPECT_TRUE(cache.find(key_of(1), result));
  EXPECT_FALSE(cache.find(key_of(2), result));
  EXPECT_EQ(toys::first(cache.once(key_of(3), [] { return Value::of(toys::numbers(3, host_memory(), 3000)); }).as<toys::Numbers>()), 3);
}

TEST(Cache, OwnersOfWrappedStorageMayCallBackIntoIt) {
  Cache cache(2000);
  const std::vector<double> owned(100);
  for (int i = 0; i < 10; ++i)
    cache.store(key_of(i), {{Value::of(toys::Numbers{Buffer<double>::wrap(owned.data(), owned.size(), {}, [&cache] { cache.figures(); })})}, {}});
  EXPECT_GT(cache.figures().evictions, 0u);
  cache.clear();
}

TEST(Cache, LetsOneThreadMakeWhatManyAskFor) {
  Cache cache;
  std::atomic<int> made{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 20; ++i) {
        const Value value = cache.once(key_of(i), [&] {
          ++made;
          std::this_thread::sleep_for(std::chrono::milliseconds(1));
          return Value::of(toys::numbers(i));
        });
        EXPECT_EQ(toys::first(value.as<toys::Numbers>()), i);
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(made, 20);
}

TEST(Cache, AFailureToMakeIsTheMakersAndTheNextTriesAgain) {
  Cache cache;
  std::atomic<int> tries{0}, failures{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      try {
        cache.once(key_of(1), [&]() -> Value {
          std::this_thread::sleep_for(std::chrono::milliseconds(2));
          if (++tries <= 2) throw Error(ErrorCode::kInput, "not yet");
          return Value::of(toys::numbers(1));
        });
      } catch (const Error&) {
        ++failures;
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(failures, 2);
  EXPECT_EQ(tries, 3);
}

TEST(Cache, SurvivesManyThreadsInLittleRoom) {
  Cache cache(5000);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 500; ++i) {
        Cache::Result result;
        EXPECT_TRUE(!cache.find(key_of((i * 7 + t) % 31), result) || value_in(result) == (i * 7 + t) % 31);
        cache.store(key_of(i % 31), result_of(i % 31, 50));
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_LE(cache.figures().bytes, 5000u);
}

}  // namespace cache_test
}  // namespace knead
