#include "graph/hash.h"

#include <new>

#define XXH_INLINE_ALL  // compiled into this file: nothing to link, no symbol to clash with a host's
#include <xxhash.h>

namespace knead {
namespace {

XXH3_state_t* state_in(unsigned char* bytes) {
  return std::launder(reinterpret_cast<XXH3_state_t*>(bytes));
}

}  // namespace

Hasher::Hasher() {
  static_assert(sizeof(XXH3_state_t) <= sizeof state_ && alignof(XXH3_state_t) <= alignof(Hasher));
  XXH3_128bits_reset(new (state_) XXH3_state_t);
}

Hasher& Hasher::bytes(const void* data, size_t size) {
  XXH3_128bits_update(state_in(state_), data, size);
  return *this;
}

Key Hasher::key() const {
  const XXH128_hash_t hash = XXH3_128bits_digest(state_in(const_cast<unsigned char*>(state_)));
  return {hash.high64, hash.low64};
}

std::string Key::text() const {
  constexpr char digits[] = "0123456789abcdef";
  std::string out;
  for (const uint64_t word : {high, low})
    for (int shift = 60; shift >= 0; shift -= 4) out += digits[(word >> shift) & 15];
  return out;
}

}  // namespace knead
