// Content hashing for cache keys: 128 bits, so that equal keys can be taken for equal contents.
#pragma once
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>

namespace knead {

struct Key {
  uint64_t high = 0, low = 0;
  friend bool operator==(const Key&, const Key&) = default;
  friend auto operator<=>(const Key&, const Key&) = default;
  std::string text() const;  // 32 hexadecimal digits
};
struct KeyHash {
  size_t operator()(const Key& key) const { return static_cast<size_t>(key.low); }
};

class Hasher {
 public:
  Hasher& bytes(const void* data, size_t size);
  Hasher& add(std::string_view text) { return add(text.size()).bytes(text.data(), text.size()); }
  Hasher& add(const char* text) { return add(std::string_view(text)); }
  Hasher& add(const Key& key) { return bytes(&key, sizeof key); }
  template <class T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) Hasher& add(T value) { return bytes(&value, sizeof value); }
  Key key() const;

 private:
  uint64_t a_ = 0x9e3779b97f4a7c15ull, b_ = 0xc2b2ae3d27d4eb4full;
  uint64_t size_ = 0;
};

}  // namespace knead
