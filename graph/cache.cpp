#include "graph/cache.h"

#include <utility>

namespace knead {

bool Cache::find(const Key& key, Result& result) {
  std::lock_guard lock(mutex_);
  const auto found = entries_.find(key);
  if (found == entries_.end()) {
    ++figures_.misses;
    return false;
  }
  ++figures_.hits;
  order_.splice(order_.begin(), order_, found->second.place);
  result = found->second.result;
  return true;
}

void Cache::store(const Key& key, Result result) {
  size_t bytes = sizeof(Entry) + 64;
  for (const Value& value : result.outputs)
    if (value) bytes += value.type()->bytes(value) + 64;
  if (bytes > most_bytes_) return;
  std::list<Key> place{key};
  std::vector<Result> evicted;  // dies after the lock is given back: the last handle of wrapped storage calls into the host application
  std::lock_guard lock(mutex_);
  const auto [entry, is_new] = entries_.try_emplace(key);
  if (!is_new) return;
  entry->second = {std::move(result), bytes, place.begin()};
  order_.splice(order_.begin(), place);
  figures_.bytes += bytes;
  while (figures_.bytes > most_bytes_) {
    const auto oldest = entries_.find(order_.back());
    evicted.push_back(std::move(oldest->second.result));
    figures_.bytes -= oldest->second.bytes;
    ++figures_.evictions;
    entries_.erase(oldest);
    order_.pop_back();
  }
}

CacheFigures Cache::figures() const {
  std::lock_guard lock(mutex_);
  CacheFigures figures = figures_;
  figures.entries = entries_.size();
  return figures;
}

void Cache::clear() {
  std::unordered_map<Key, Entry, KeyHash> dropped;  // dies after the lock is given back, as above
  std::lock_guard lock(mutex_);
  dropped.swap(entries_);
  order_.clear();
  figures_.bytes = 0;
}

Value Cache::once(const Key& key, FunctionRef<Value()> make) {
  {
    std::unique_lock lock(mutex_);
    made_.wait(lock, [&] { return !making_.count(key); });
    if (const auto found = entries_.find(key); found != entries_.end()) {
      ++figures_.hits;
      order_.splice(order_.begin(), order_, found->second.place);
      return found->second.result.outputs.front();
    }
    ++figures_.misses;
    making_.insert(key);
  }
  const auto finish = [&] {
    {
      std::lock_guard lock(mutex_);
      making_.erase(key);
    }
    made_.notify_all();
  };
  try {
    Value value = make();
    store(key, {{value}, {}});
    finish();
    return value;
  } catch (...) {
    finish();
    throw;
  }
}

}  // namespace knead
