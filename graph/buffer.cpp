#include "graph/buffer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdlib>
#include <limits>
#include <mutex>
#include <new>

#include "graph/error.h"
#include "graph/executor.h"
#include "graph/value.h"

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/asan_interface.h>
#else
#define ASAN_POISON_MEMORY_REGION(address, size) ((void)(address), (void)(size))
#define ASAN_UNPOISON_MEMORY_REGION(address, size) ((void)(address), (void)(size))
#endif

namespace knead {

std::string Device::text() const {
  switch (kind) {
    case DeviceKind::kHost: return "host";
    case DeviceKind::kCuda: return "cuda:" + std::to_string(index);
    case DeviceKind::kFake: return "fake:" + std::to_string(index);
  }
  return "unknown";
}

namespace {

[[noreturn]] void throw_out_of_memory(const std::string& size) {
  throw Error(ErrorCode::kMemory, "out of memory: " + size + " were asked for", "lower the resolution, or run fewer frames at once");
}

// Blocks are rounded up to an eighth of a power of two, so at most 12.5 % is lost, and freed blocks wait in one list per rounded size. What waits is
// bounded. AddressSanitizer sees what waits, and what was rounded up, as not allocated.
class HostPool : public MemoryResource {
 public:
  void* allocate(size_t bytes) override {
    if (bytes > kMostBytes) throw_out_of_memory(std::to_string(bytes) + " bytes");
    const size_t rounded = round_up(bytes);
    void* storage = take(rounded);
    if (!storage) {
      storage = std::aligned_alloc(kAlignment, rounded);
      if (!storage) {
        trim();
        storage = std::aligned_alloc(kAlignment, rounded);
      }
      if (!storage) throw_out_of_memory(std::to_string(bytes) + " bytes");
      from_system_.fetch_add(1, std::memory_order_relaxed);
    }
    ASAN_POISON_MEMORY_REGION(static_cast<char*>(storage) + bytes, rounded - bytes);
    return storage;
  }

  void release(void* storage, size_t bytes) noexcept override {
    const size_t rounded = round_up(bytes);
    ASAN_UNPOISON_MEMORY_REGION(storage, rounded);
    {
      std::lock_guard lock(mutex_);
      if (kept_ + rounded <= kMostKept) {
        Free*& list = list_of(rounded);
        list = new (storage) Free{list};
        kept_ += rounded;
        ASAN_POISON_MEMORY_REGION(list + 1, rounded - sizeof(Free));  // the list stays readable, for the leak checker follows it
        return;
      }
    }
    std::free(storage);
  }

  Device device() const override { return {}; }

  HostMemoryFigures figures() {
    std::lock_guard lock(mutex_);
    return {from_system_.load(std::memory_order_relaxed), kept_};
  }

 private:
  static constexpr size_t kAlignment = 64;
  static constexpr size_t kMostKept = size_t{1} << 30;
  static constexpr size_t kMostBytes = std::numeric_limits<size_t>::max() / 4;
  struct Free {
    Free* next;
  };

  static size_t round_up(size_t bytes) {
    const size_t least = std::max<size_t>(bytes, kAlignment);
    const size_t step = std::max<size_t>(kAlignment, std::bit_floor(least) / 8);
    return (least + step - 1) / step * step;
  }
  // Rounded sizes map to distinct slots: the power of two and the eighth within it.
  Free*& list_of(size_t rounded) {
    const int power = std::bit_width(rounded) - 1;
    const size_t eighth = (rounded - std::bit_floor(rounded)) / std::max<size_t>(kAlignment, std::bit_floor(rounded) / 8);
    return lists_[static_cast<size_t>(power) * 8 + eighth];
  }
  void* take(size_t rounded) {
    std::lock_guard lock(mutex_);
    Free*& list = list_of(rounded);
    if (!list) return nullptr;
    ASAN_UNPOISON_MEMORY_REGION(list, rounded);
    kept_ -= rounded;
    return std::exchange(list, list->next);
  }
  void trim() {
    std::lock_guard lock(mutex_);
    for (Free*& list : lists_)
      while (list) {
        ASAN_UNPOISON_MEMORY_REGION(list, sizeof(Free));
        std::free(std::exchange(list, list->next));
      }
    kept_ = 0;
  }

  std::mutex mutex_;
  std::array<Free*, 64 * 8> lists_{};
  size_t kept_ = 0;
  std::atomic<uint64_t> from_system_{0};
};

std::atomic<uint64_t> next_buffer_id{1};

}  // namespace

static HostPool& host_pool() {
  static HostPool* const pool = new HostPool;  // never destroyed: buffers in static storage of the host application may outlive every other object
  return *pool;
}
MemoryResource& host_memory() {
  return host_pool();
}
HostMemoryFigures host_memory_figures() {
  return host_pool().figures();
}

namespace detail {

BufferBlock* new_buffer_block(size_t count, size_t element_bytes, size_t padding_bytes, MemoryResource& resource) {
  if (count > (std::numeric_limits<size_t>::max() - padding_bytes) / element_bytes)
    throw_out_of_memory(std::to_string(count) + " elements of " + std::to_string(element_bytes) + " bytes");
  const size_t bytes = count * element_bytes + padding_bytes;
  auto* block = new (host_memory().allocate(sizeof(BufferBlock))) BufferBlock;
  try {
    block->data = resource.allocate(bytes);
  } catch (...) {
    block->~BufferBlock();
    host_memory().release(block, sizeof(BufferBlock));
    throw;
  }
  block->id = next_buffer_id.fetch_add(1, std::memory_order_relaxed);
  block->bytes = bytes;
  block->device = resource.device();
  block->resource = &resource;
  return block;
}

BufferBlock* wrap_buffer_block(void* data, size_t bytes, Device device, std::function<void()> release_wrapped) {
  auto* block = new (host_memory().allocate(sizeof(BufferBlock))) BufferBlock;
  block->id = next_buffer_id.fetch_add(1, std::memory_order_relaxed);
  block->data = data;
  block->bytes = bytes;
  block->device = device;
  block->release_wrapped = std::move(release_wrapped);
  return block;
}

void release(BufferBlock* block) noexcept {
  if (block->references.fetch_sub(1, std::memory_order_acq_rel) != 1) return;
  if (block->resource) block->resource->release(block->data, block->bytes);
  if (block->release_wrapped) block->release_wrapped();
  block->~BufferBlock();
  host_memory().release(block, sizeof(BufferBlock));
}

void throw_wrong_device(Device is, Device asked) {
  throw Error(ErrorCode::kDevice, "a buffer on " + is.text() + " was asked for on " + asked.text(), "only the scheduler moves data between devices");
}
void throw_shared_write() {
  throw Error(ErrorCode::kInternal, "a published buffer cannot be written to");
}

void throw_type_mismatch(const PortType* is, const PortType& asked) {
  throw Error(ErrorCode::kInternal, std::string("a value of type ") + (is ? is->name : "nothing") + " was read as " + asked.name);
}

}  // namespace detail
}  // namespace knead
