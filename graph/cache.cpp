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
  std::lock_guard lock(mutex_);
  if (entries_.count(key) || bytes > most_bytes_) return;
  while (figures_.bytes + bytes > most_bytes_) {
    const auto oldest = entries_.find(order_.back());
    figures_.bytes -= oldest->second.bytes;
    ++figures_.evictions;
    entries_.erase(oldest);
    order_.pop_back();
  }
  order_.push_front(key);
  entries_.emplace(key, Entry{std::move(result), bytes, order_.begin()});
  figures_.bytes += bytes;
}

CacheFigures Cache::figures() const {
  std::lock_guard lock(mutex_);
  CacheFigures figures = figures_;
  figures.entries = entries_.size();
  return figures;
}

void Cache::clear() {
  std::lock_guard lock(mutex_);
  entries_.clear();
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
