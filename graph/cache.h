// Results by content key, least recently used first out. Thread-safe. May be shared by evaluators, so that an edited graph finds what the edit did
// not reach.
#pragma once
#include <condition_variable>
#include <cstdint>
#include <list>
#include <mutex>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "graph/executor.h"
#include "graph/hash.h"
#include "graph/value.h"

namespace knead {

struct CacheFigures {
  uint64_t hits = 0, misses = 0, evictions = 0;
  size_t bytes = 0, entries = 0;
};

class KNEAD_API Cache {
 public:
  explicit Cache(size_t most_bytes = size_t{4} << 30) : most_bytes_(most_bytes) {}

  struct Result {
    std::vector<Value> outputs;
    std::vector<std::string> warnings;
  };

  bool find(const Key& key, Result& result);  // counts a hit or a miss
  void store(const Key& key, Result result);
  CacheFigures figures() const;
  void clear();

  // One thread makes, the others that ask for the same key wait for it. `make` runs without the cache's lock.
  Value once(const Key& key, FunctionRef<Value()> make);

 private:
  struct Entry {
    Result result;
    size_t bytes = 0;
    std::list<Key>::iterator place;
  };
  mutable std::mutex mutex_;
  std::condition_variable made_;
  std::set<Key> making_;
  std::unordered_map<Key, Entry, KeyHash> entries_;
  std::list<Key> order_;  // most recently used first
  CacheFigures figures_;
  size_t most_bytes_;
};

}  // namespace knead
