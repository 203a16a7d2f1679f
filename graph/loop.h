// A loop that stays on its device. `iterate` runs a first round from the host, which gives its state storage of its own. It then records one round
// that reads this storage, and adds the two steps that close a round: `LoopEnd` decides, on the device, whether the loop goes on, and `LoopCommit`
// writes the next state over the state. What is recorded runs round after round, without the host, a transfer or an allocation.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "graph/executor.h"

namespace knead {

// Lives on the device while the loop runs.
struct LoopProgress {
  double unrest = 0;       // of the last round
  int32_t iterations = 0;  // rounds made
  int32_t left = 0;        // rounds until the host is asked again
  int32_t going = 1;       // another round is to be made
  int32_t at_rest = 0;
  int32_t broken = -1;  // the state that is no longer a number
  int32_t counted = 0;  // the round just made counts: rounds after the end are made by devices that cannot stop by themselves, and come to nothing
};

struct LoopBegin {
  static constexpr const char* kKernel = "loop_begin";
  LoopProgress* progress;
  KNEAD_HD void operator()(uint32_t) const { *progress = LoopProgress{}; }
};

// Before rounds are run: as many of them as the device may make on its own.
struct LoopGo {
  static constexpr const char* kKernel = "loop_go";
  LoopProgress* progress;
  int32_t rounds;
  KNEAD_HD void operator()(uint32_t) const { progress->left = rounds; }
};

// One index.
struct LoopEnd {
  static constexpr const char* kKernel = "loop_end";
  static constexpr uint32_t kMostStates = 16;
  const double* unrest[kMostStates];  // of the states that have one
  int32_t state[kMostStates];         // which these are
  uint32_t count;
  LoopProgress* progress;
  double threshold;
  int32_t min_iterations, max_iterations;

  KNEAD_HD bool running() const { return progress->going && progress->left > 0; }

  KNEAD_HD void operator()(uint32_t) const {
    LoopProgress now = *progress;
    now.counted = now.going && now.left > 0;
    if (now.counted) {
      ++now.iterations;
      --now.left;
      now.unrest = 0;
      for (uint32_t s = 0; s < count; ++s) {
        const double one = *unrest[s];
        if (!(one - one == 0) && now.broken < 0) now.broken = state[s];
        now.unrest = one > now.unrest ? one : now.unrest;
      }
      now.at_rest = count > 0 && now.iterations >= min_iterations && now.unrest <= threshold;
      now.going = !now.at_rest && now.broken < 0 && now.iterations < max_iterations;
    }
    *progress = now;
  }
};

// An index is a word of 4 bytes in every range that is so long.
struct LoopCommit {
  static constexpr const char* kKernel = "loop_commit";
  static constexpr uint32_t kMostRanges = 32;
  struct Range {
    const uint32_t* from;
    uint32_t* to;
    uint32_t words;
  };
  Range ranges[kMostRanges];
  uint32_t count;
  const LoopProgress* progress;

  KNEAD_HD void operator()(uint32_t i) const {
    if (!progress->counted) return;
    for (uint32_t r = 0; r < count; ++r)
      if (i < ranges[r].words) ranges[r].to[i] = ranges[r].from[i];
  }
};

struct CopyWords {
  static constexpr const char* kKernel = "copy_words";
  const uint32_t* from;
  uint32_t* to;
  KNEAD_HD void operator()(uint32_t i) const { to[i] = from[i]; }
};

// Words that hold so many bytes; storage is padded, so that the last one may be read and written as a whole.
inline size_t words_of(size_t bytes) {
  return (bytes + 3) / 4;
}

// The executor of the round that is recorded. Its memory is its own until it is destroyed, so that what one node frees serves the next node of the
// round and nobody else; nothing that lives there may outlive it.
class LoopRecorder : public Executor {
 public:
  // Runs what was recorded until `end` says so, or `rounds` are made. `words`: of the longest range.
  virtual LoopProgress run(const LoopEnd& end, const LoopCommit& commit, size_t words, int rounds) = 0;

  // True when a node has asked for what the host has to do; what was recorded is then of no use.
  bool gave_up() const { return gave_up_; }
  // Throws.
  [[noreturn]] void give_up(const char* asked);

 private:
  bool gave_up_ = false;
};

// Storage of one recorder: freed blocks are used again by size.
class LoopMemory : public MemoryResource {
 public:
  explicit LoopMemory(MemoryResource& from) : from_(from) {}
  ~LoopMemory() override;
  void* allocate(size_t bytes) override;
  void release(void* storage, size_t bytes) noexcept override;
  Device device() const override { return from_.device(); }
  size_t used() const { return used_; }  // blocks

 private:
  MemoryResource& from_;
  std::multimap<size_t, void*> free_;
  std::vector<std::pair<void*, size_t>> blocks_;
  size_t used_ = 0;
};

}  // namespace knead
