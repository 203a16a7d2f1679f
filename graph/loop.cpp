#include "graph/loop.h"

#include <string>

#include "graph/error.h"

namespace knead {

void LoopRecorder::give_up(const char* asked) {
  gave_up_ = true;
  throw Error(ErrorCode::kDevice, std::string(asked) + " inside a loop on " + device().text(), "the loop is run from the host instead");
}

LoopMemory::~LoopMemory() {
  for (const auto& [storage, bytes] : blocks_) from_.release(storage, bytes);
}

void* LoopMemory::allocate(size_t bytes) {
  if (const auto kept = free_.find(bytes); kept != free_.end()) {
    void* storage = kept->second;
    free_.erase(kept);
    ++used_;
    return storage;
  }
  blocks_.reserve(blocks_.size() + 1);
  void* storage = from_.allocate(bytes);
  blocks_.emplace_back(storage, bytes);
  ++used_;
  return storage;
}

void LoopMemory::release(void* storage, size_t bytes) noexcept {
  --used_;
  free_.emplace(bytes, storage);
}

}  // namespace knead
