#include "graph/buffer.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <numeric>

#include "tests/graph/toys.h"

namespace knead {
namespace buffer_test {

ErrorCode code_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.code();
  }
  ADD_FAILURE() << "no error was thrown";
  return ErrorCode::kGraph;
}

// Counts, and refuses beyond a number of bytes.
class StrictMemory : public MemoryResource {
 public:
  explicit StrictMemory(size_t most, Device device = {}) : most_(most), device_(device) {}
  void* allocate(size_t bytes) override {
    if (held + bytes > most_) throw Error(ErrorCode::kMemory, "out of memory: " + std::to_string(bytes) + " bytes were asked for");
    held += bytes;
    return host_memory().allocate(bytes);
  }
  void release(void* storage, size_t bytes) noexcept override {
    held -= bytes;
    host_memory().release(storage, bytes);
  }
  Device device() const override { return device_; }
  size_t held = 0;

 private:
  size_t most_;
  Device device_;
};

TEST(Buffer, IsWrittenByItsOnlyHandleAndReadByAll) {
  Buffer<int> one(3);
  int* out = one.data_for_write();
  std::iota(out, out + 3, 7);
  const Buffer<int> other = one;
  EXPECT_EQ(other.host()[2], 9);
  EXPECT_EQ(other.id(), one.id());
  EXPECT_EQ(other.host().data(), one.host().data());
  EXPECT_EQ(code_of([&] { one.data_for_write(); }), ErrorCode::kInternal);
}

TEST(Buffer, CanBeWrittenAgainWhenTheOtherHandleIsGone) {
  Buffer<int> one(3);
  { const Buffer<int> other = one; }
  EXPECT_NE(one.data_for_write(), nullptr);
}

TEST(Buffer, EmptyHandlesAreHarmless) {
  Buffer<int> none;
  EXPECT_FALSE(none);
  EXPECT_TRUE(none.empty());
  EXPECT_TRUE(none.host().empty());
  EXPECT_TRUE(none.view({DeviceKind::kFake, 0}).empty());
  EXPECT_EQ(none.data_for_write(), nullptr);
  EXPECT_EQ(none.id(), 0u);
  const Buffer<int> zero(0);
  EXPECT_TRUE(zero);
  EXPECT_TRUE(zero.host().empty());
}

TEST(Buffer, IsMovedAndAssignedWithoutLosingOrDoublingAHandle) {
  StrictMemory memory(1 << 20);
  {
    Buffer<int> a(4, memory), b(8, memory);
    const uint64_t id = a.id();
    b = std::move(a);
    EXPECT_EQ(b.id(), id);
    EXPECT_EQ(b.size(), 4u);
    EXPECT_FALSE(a);
    b = *&b;
    EXPECT_EQ(b.id(), id);
    EXPECT_NE(b.data_for_write(), nullptr);
    EXPECT_EQ(memory.held, 4 * sizeof(int) + Buffer<int>::kPaddingBytes);
  }
  EXPECT_EQ(memory.held, 0u);
}

TEST(Buffer, WrapsStorageWithoutACopyAndTellsItsOwnerOnceWhenTheLastHandleIsGone) {
  std::vector<float> owned{1, 2, 3};
  int released = 0;
  {
    Buffer<float> borrowed = Buffer<float>::wrap(owned.data(), owned.size(), {}, [&] { ++released; });
    const Buffer<float> another = borrowed;
    EXPECT_EQ(another.host().data(), owned.data());
    borrowed = {};
    EXPECT_EQ(released, 0);
  }
  EXPECT_EQ(released, 1);
}

TEST(Buffer, RefusesToWriteToWrappedStorage) {
  const std::vector<float> owned{1, 2, 3};
  Buffer<float> borrowed = Buffer<float>::wrap(owned.data(), owned.size(), {}, {});
  EXPECT_EQ(code_of([&] { borrowed.data_for_write(); }), ErrorCode::kInternal);
}

TEST(Buffer, AsksForTheRightDevice) {
  StrictMemory fake(1 << 20, {DeviceKind::kFake, 1});
  const Buffer<int> there(4, fake);
  EXPECT_EQ(there.view({DeviceKind::kFake, 1}).size(), 4u);
  EXPECT_EQ(code_of([&] { there.host(); }), ErrorCode::kDevice);
  EXPECT_EQ(code_of([&] { there.view({DeviceKind::kFake, 0}); }), ErrorCode::kDevice);
  try {
    there.host();
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "a buffer on fake:1 was asked for on host (only the scheduler moves data between devices)");
  }
}

TEST(Buffer, RunsOutOfMemoryWithAnErrorAndLeavesNothingBehind) {
  StrictMemory memory(1000);
  const Buffer<double> fits(50, memory);
  EXPECT_EQ(code_of([&] { Buffer<double>(100, memory); }), ErrorCode::kMemory);
  EXPECT_EQ(memory.held, 50 * sizeof(double) + Buffer<double>::kPaddingBytes);
  EXPECT_EQ(Buffer<double>(10, memory).size(), 10u);
}

TEST(Buffer, RefusesSizesThatNoMemoryHas) {
  EXPECT_EQ(code_of([] { Buffer<double>(SIZE_MAX); }), ErrorCode::kMemory);
  EXPECT_EQ(code_of([] { Buffer<double>(SIZE_MAX / 8 - 4); }), ErrorCode::kMemory);
  EXPECT_EQ(code_of([] { Buffer<char>(SIZE_MAX / 2); }), ErrorCode::kMemory);
}

TEST(HostMemory, IsAlignedAndHasRoomToReadOverTheEnd) {
  for (size_t size : {0u, 1u, 63u, 64u, 65u, 1000u, 4097u, 100000u}) {
    Buffer<unsigned char> bytes(size);
    unsigned char* out = bytes.data_for_write();
    EXPECT_EQ(reinterpret_cast<uintptr_t>(out) % 64, 0u);
    std::fill_n(out, size + Buffer<unsigned char>::kPaddingBytes, static_cast<unsigned char>(1));
  }
}

TEST(HostMemory, UsesFreedBlocksAgain) {
  { const Buffer<double> warm(12800); }
  const uint64_t before = host_memory_figures().from_system;
  for (int i = 0; i < 100; ++i) {
    const Buffer<double> a(12800 - static_cast<size_t>(i));  // the same rounded size
    EXPECT_EQ(host_memory_figures().from_system, before);
  }
}

TEST(HostMemory, KeepsBlocksOfDifferentSizesApart) {
  std::vector<Buffer<unsigned char>> all;
  for (int pass = 0; pass < 3; ++pass) {
    all.clear();
    for (size_t size = 1; size < 5000; size += 37) {
      all.emplace_back(size);
      std::fill_n(all.back().data_for_write(), size, static_cast<unsigned char>(size));
    }
    for (const auto& buffer : all)
      for (const unsigned char byte : buffer.host()) ASSERT_EQ(byte, static_cast<unsigned char>(buffer.size()));
  }
}

TEST(Value, IsSharedTypedAndSaysWhatItHolds) {
  const Value value = Value::of(toys::numbers(3));
  const Value same = value;
  EXPECT_EQ(toys::first(same.as<toys::Numbers>()), 3);
  EXPECT_EQ(same.get_if<toys::Word>(), nullptr);
  EXPECT_EQ(code_of([&] { same.as<toys::Word>(); }), ErrorCode::kInternal);
  EXPECT_EQ(code_of([&] { Value().as<toys::Word>(); }), ErrorCode::kInternal);
  EXPECT_EQ(value.type()->bytes(value), sizeof(double));
  EXPECT_TRUE(value.type()->on_device(value, {}));
  EXPECT_FALSE(value.type()->on_device(value, {DeviceKind::kFake, 0}));
}

TEST(Value, ContentIsThatOfItsBuffersAndOfWhatTheyDoNotHold) {
  const auto content = [](const Value& value) { return value.type()->content(value); };
  EXPECT_EQ(content(Value::of(toys::numbers(3))), content(Value::of(toys::numbers(3))));
  EXPECT_NE(content(Value::of(toys::numbers(3))), content(Value::of(toys::numbers(4))));
  EXPECT_NE(content(Value::of(toys::Word{"a"})), content(Value::of(toys::Word{"b"})));
  Report report, other;
  report.set("iterations", 3.0);
  other.set("iterations", 4.0);
  EXPECT_NE(content(Value::of(report)), content(Value::of(other)));
}

}  // namespace buffer_test
}  // namespace knead
