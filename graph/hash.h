// Content hashing for cache keys: XXH3's 128 bits (Collet 2021), so that equal keys can be taken for equal contents.
#pragma once
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>

#include "graph/api.h"

namespace knead {

struct KNEAD_API Key {
  uint64_t high = 0, low = 0;
  friend bool operator==(const Key&, const Key&) = default;
  friend auto operator<=>(const Key&, const Key&) = default;
  std::string text() const;  // 32 hexadecimal digits
};
struct KeyHash {
  size_t operator()(const Key& key) const { return static_cast<size_t>(key.low); }
};

class KNEAD_API Hasher {
 public:
  Hasher();
  Hasher& bytes(const void* data, size_t size);
  Hasher& add(std::string_view text) { return add(text.size()).bytes(text.data(), text.size()); }
  Hasher& add(const char* text) { return add(std::string_view(text)); }
  Hasher& add(const Key& key) { return bytes(&key, sizeof key); }
  template <class T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) Hasher& add(T value) { return bytes(&value, sizeof value); }
  Key key() const;

 private:
  alignas(64) unsigned char state_[576];  // XXH3's
};

}  // namespace knead
