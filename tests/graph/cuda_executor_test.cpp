// What only a device can show of its executor: transfers through pinned memory, kernels over more indices than a block or a launch likes, threads
// side by side, memory that is given back. The fake device runs them too, so that they can fail on every machine.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "graph/loop.h"
#include "tests/graph/toys.h"
#include "tests/kernels/on_device.h"

namespace knead {
namespace cuda_executor_test {

using on_device::back;
using on_device::there;
using testing::HasSubstr;

std::vector<uint32_t> numbers(size_t n, uint32_t seed) {
  std::vector<uint32_t> made(n);
  for (size_t i = 0; i < n; ++i) made[i] = static_cast<uint32_t>(i) * 2654435761u + seed;
  return made;
}
// There, through a kernel, and back.
std::vector<uint32_t> round_trip(Executor& device, const std::vector<uint32_t>& values) {
  const Buffer<uint32_t> from = there(device, Buffer<uint32_t>(values));
  Buffer<uint32_t> to(values.size(), device.memory());
  device.launch(CopyWords{from.view(device.device()).data(), to.data_for_write()}, values.size());
  return back(device, to);
}

class DeviceExecutors : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    device_ = on_device::device_named(GetParam());
    KNEAD_NEEDS(device_);
  }
  bool fake() const { return std::string(GetParam()) == "fake"; }
  std::unique_ptr<Executor> device_;
};

// Pinned memory is 1 MiB, and used by turns.
TEST_P(DeviceExecutors, BytesOfAnyNumberComeBackAsTheyWere) {
  constexpr size_t kPiece = size_t{1} << 20;
  for (const size_t bytes : {size_t{1}, size_t{3}, kPiece - 1, kPiece, kPiece + 1, 2 * kPiece, 5 * kPiece + 7}) {
    std::vector<unsigned char> values(bytes);
    for (size_t i = 0; i < bytes; ++i) values[i] = static_cast<unsigned char>(i * 7 + i / kPiece);
    EXPECT_EQ(back(*device_, there(*device_, Buffer<unsigned char>(values))), values) << bytes;
  }
}

TEST_P(DeviceExecutors, KernelsReachEveryIndexAndNoOther) {
  for (const size_t n : {size_t{1}, size_t{127}, size_t{128}, size_t{129}, fake() ? size_t{300'003} : size_t{20'000'003}}) {
    const std::vector<uint32_t> values = numbers(n, 1);
    const Buffer<uint32_t> from = there(*device_, Buffer<uint32_t>(values));
    Buffer<uint32_t> to = there(*device_, Buffer<uint32_t>(std::vector<uint32_t>(n + 1, 77)));
    device_->launch(CopyWords{from.view(device_->device()).data(), to.data_for_write()}, n);
    std::vector<uint32_t> is = back(*device_, to);
    EXPECT_EQ(is.back(), 77u) << n;
    is.pop_back();
    EXPECT_TRUE(is == values) << n;
  }
}

// Each with frames of its own, in two shifts: the second finds the streams of the first. A thread's last buffer is given back by another thread.
TEST_P(DeviceExecutors, ThreadsAtOnceDoNotDisturbEachOther) {
  constexpr size_t kThreads = 8;
  for (int shift = 0; shift < 2; ++shift) {
    std::vector<Buffer<uint32_t>> left(kThreads);
    std::vector<int> wrong(kThreads);
    std::vector<std::thread> threads;
    for (size_t t = 0; t < kThreads; ++t)
      threads.emplace_back([&, t] {
        device_->begin_frames();
        for (uint32_t round = 0; round < 20; ++round) {
          const std::vector<uint32_t> values = numbers(1000 + 9001 * ((t + round) % 5), static_cast<uint32_t>(t) * 100 + round);
          wrong[t] += round_trip(*device_, values) != values;
        }
        left[t] = there(*device_, Buffer<uint32_t>(numbers(5000, static_cast<uint32_t>(t))));
        device_->end_frames();
      });
    for (std::thread& thread : threads) thread.join();
    for (size_t t = 0; t < kThreads; ++t) {
      EXPECT_EQ(wrong[t], 0);
      EXPECT_EQ(back(*device_, left[t]), numbers(5000, static_cast<uint32_t>(t)));
    }
  }
  EXPECT_EQ(on_device::figures_of(*device_).bytes, 0u);
}

// More in all than the device has.
TEST_P(DeviceExecutors, MemoryThatIsGivenBackIsThereAgain) {
  const size_t bytes = fake() ? size_t{1} << 20 : size_t{1} << 30;
  for (int round = 0; round < (fake() ? 5000 : 300); ++round) {
    const Buffer<unsigned char> one(bytes, device_->memory());
    ASSERT_EQ(on_device::figures_of(*device_).bytes, bytes + Buffer<unsigned char>::kPaddingBytes);
  }
}

TEST_P(DeviceExecutors, ExecutorsComeAndGo) {
  for (int round = 0; round < 3; ++round) {
    const auto other = on_device::device_named(GetParam());
    EXPECT_EQ(round_trip(*other, numbers(1000, 5)), numbers(1000, 5));
    EXPECT_EQ(round_trip(*device_, numbers(1000, 6)), numbers(1000, 6));
  }
}

INSTANTIATE_TEST_SUITE_P(On, DeviceExecutors, testing::Values("fake", "cuda"), [](const auto& info) { return std::string(info.param); });

TEST(CudaExecutor, ABodyWithoutCodeForItIsAnErrorThatNamesTheKernel) {
  const auto cuda = on_device::device_named("cuda");
  KNEAD_NEEDS(cuda);
  Buffer<double> values(1, cuda->memory());
  double* const value = values.data_for_write();
  try {
    cuda->launch(toys::AddOffset{value, value, 1}, 1);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kDevice);
    EXPECT_THAT(error.what(), HasSubstr("toy_add"));
  }
  EXPECT_EQ(round_trip(*cuda, numbers(10, 1)), numbers(10, 1));
}

TEST(CudaExecutor, ADeviceThatIsNotThereIsAnErrorThatSaysWhatToDo) {
  const CudaDevices found = cuda_devices();
  EXPECT_EQ(found.devices.empty(), !found.missing.empty());
  try {
    make_cuda_executor(1000);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kDevice);
    EXPECT_FALSE(error.hint().empty());
  }
}

}  // namespace cuda_executor_test
}  // namespace knead
