#include "graph/hash.h"

namespace knead {

static uint64_t mixed(uint64_t v) {  // finaliser of splitmix64
  v ^= v >> 30;
  v *= 0xbf58476d1ce4e5b9ull;
  v ^= v >> 27;
  v *= 0x94d049bb133111ebull;
  return v ^ (v >> 31);
}

static uint64_t folded(uint64_t a, uint64_t b) {
  const auto product = static_cast<unsigned __int128>(a) * b;
  return static_cast<uint64_t>(product) ^ static_cast<uint64_t>(product >> 64);
}

Hasher& Hasher::bytes(const void* data, size_t size) {
  const auto* p = static_cast<const unsigned char*>(data);
  size_ += size;
  for (; size >= 8; p += 8, size -= 8) {
    uint64_t word;
    std::memcpy(&word, p, 8);
    a_ = folded(a_ ^ word, 0x9fb21c651e98df25ull) + b_;
    b_ = (b_ ^ mixed(word + a_)) * 0xd6e8feb86659fd93ull;
  }
  if (size > 0) {
    uint64_t word = size << 56;
    std::memcpy(&word, p, size);
    a_ = folded(a_ ^ word, 0x9fb21c651e98df25ull) + b_;
    b_ = (b_ ^ mixed(word + a_)) * 0xd6e8feb86659fd93ull;
  }
  return *this;
}

Key Hasher::key() const {
  return {mixed(a_ + size_), mixed(b_ ^ (a_ << 1) ^ size_)};
}

std::string Key::text() const {
  constexpr char digits[] = "0123456789abcdef";
  std::string out;
  for (const uint64_t word : {high, low})
    for (int shift = 60; shift >= 0; shift -= 4) out += digits[(word >> shift) & 15];
  return out;
}

}  // namespace knead
