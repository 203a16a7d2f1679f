// Typed storage shared by handle, tagged with the device it lives on. Immutable once published: write through `data_for_write` while the handle is
// the only one, then hand copies out. Nothing here moves data between devices; the scheduler does (see evaluator.h).
#pragma once
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "graph/api.h"

namespace knead {

enum class DeviceKind : uint8_t { kHost, kCuda, kFake };  // kFake is host memory under another tag: it lets tests check residency without a GPU

struct KNEAD_API Device {
  DeviceKind kind = DeviceKind::kHost;
  int index = 0;
  friend bool operator==(Device, Device) = default;
  std::string text() const;  // "host", "cuda:0"
};

// Allocates and frees raw storage of one device. Thread-safe. Throws Error(kMemory) naming the size when there is none left.
class KNEAD_API MemoryResource {
 public:
  virtual ~MemoryResource() = default;
  virtual void* allocate(size_t bytes) = 0;
  virtual void release(void* storage, size_t bytes) noexcept = 0;
  virtual Device device() const = 0;
};

// The process-wide host pool: 64-byte aligned, keeps freed blocks by size so that a loop reaches the system allocator only in its first rounds.
KNEAD_API MemoryResource& host_memory();

struct HostMemoryFigures {
  uint64_t from_system = 0;  // blocks that the pool had to ask the system for: stands still while a loop runs
  size_t kept_bytes = 0;     // in freed blocks that wait to be used again
};
KNEAD_API HostMemoryFigures host_memory_figures();

namespace detail {
struct BufferBlock {
  std::atomic<uint32_t> references{1};
  uint64_t id = 0;  // unique in the process: equal ids mean equal contents, since published buffers never change
  void* data = nullptr;
  size_t bytes = 0;
  Device device;
  MemoryResource* resource = nullptr;     // null when the storage is wrapped
  std::function<void()> release_wrapped;  // tells the owner of wrapped storage that the last handle is gone
};
KNEAD_API BufferBlock* new_buffer_block(size_t count, size_t element_bytes, size_t padding_bytes, MemoryResource& resource);
KNEAD_API BufferBlock* wrap_buffer_block(void* data, size_t bytes, Device device, std::function<void()> release);
KNEAD_API void release(BufferBlock* block) noexcept;
[[noreturn]] KNEAD_API void throw_wrong_device(Device is, Device asked);
[[noreturn]] KNEAD_API void throw_shared_write();
}  // namespace detail

template <class T>
class Buffer {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  // Host storage is padded so that a 64-byte load that starts at any element stays inside the allocation.
  static constexpr size_t kPaddingBytes = 64;

  Buffer() = default;
  explicit Buffer(size_t size, MemoryResource& resource = host_memory())
      : block_(detail::new_buffer_block(size, sizeof(T), kPaddingBytes, resource)), size_(size) {}
  explicit Buffer(std::span<const T> values, MemoryResource& resource = host_memory()) : Buffer(values.size(), resource) {
    T* out = data_for_write();
    for (size_t i = 0; i < values.size(); ++i) out[i] = values[i];
  }
  explicit Buffer(const std::vector<T>& values) : Buffer(std::span<const T>(values)) {}

  // Borrows storage that somebody else owns, without a copy. `release` runs when the last handle is gone. The owner must not write while handles
  // live. Wrapped storage has no padding; kernels that over-read must copy it first (Executor::copy does).
  static Buffer wrap(const T* data, size_t size, Device device, std::function<void()> release) {
    Buffer buffer;
    buffer.block_ = detail::wrap_buffer_block(const_cast<T*>(data), size * sizeof(T), device, std::move(release));
    buffer.size_ = size;
    return buffer;
  }

  Buffer(const Buffer& other) : block_(other.block_), size_(other.size_) {
    if (block_) block_->references.fetch_add(1, std::memory_order_relaxed);
  }
  Buffer(Buffer&& other) noexcept : block_(std::exchange(other.block_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  Buffer& operator=(Buffer other) noexcept {
    std::swap(block_, other.block_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~Buffer() {
    if (block_) detail::release(block_);
  }

  size_t size() const { return size_; }
  size_t bytes() const { return size_ * sizeof(T); }
  bool empty() const { return size_ == 0; }
  explicit operator bool() const { return block_ != nullptr; }
  Device device() const { return block_ ? block_->device : Device{}; }
  uint64_t id() const { return block_ ? block_->id : 0; }
  bool is_padded() const { return block_ && block_->resource; }  // false for wrapped storage

  // The contents, for code that runs on `device`. Asking for another device than the buffer's is an error, never a hidden copy.
  std::span<const T> view(Device device) const {
    if (!block_) return {};
    if (block_->device != device) detail::throw_wrong_device(block_->device, device);
    return {static_cast<const T*>(block_->data), size_};
  }
  std::span<const T> host() const { return view(Device{}); }

  // The same storage, seen as elements of another type; a rest that is no whole element is left out.
  template <class U>
  Buffer<U> as() const {
    Buffer<U> other;
    other.block_ = block_;
    other.size_ = bytes() / sizeof(U);
    if (block_) block_->references.fetch_add(1, std::memory_order_relaxed);
    return other;
  }

  // Storage to fill before publishing. Throws when another handle shares it or when it is wrapped.
  T* data_for_write() {
    if (!block_) return nullptr;
    if (block_->references.load(std::memory_order_acquire) != 1 || !block_->resource) detail::throw_shared_write();
    return static_cast<T*>(block_->data);
  }

 private:
  template <class U>
  friend class Buffer;
  detail::BufferBlock* block_ = nullptr;
  size_t size_ = 0;
};

}  // namespace knead
