#include "graph/hash.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <vector>

namespace knead {
namespace hash_test {

TEST(Hasher, IsXxh3Of128Bits) {
  EXPECT_EQ(Hasher().key().text(), "99aa06d3014798d86001c324468d497f");  // of no bytes, as xxHash's own tests have it
}

TEST(Hasher, TakesBytesInPiecesAsInOne) {
  std::vector<unsigned char> bytes(5000);
  for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<unsigned char>(31 * i >> 2);
  const Key whole = Hasher().bytes(bytes.data(), bytes.size()).key();
  for (const size_t piece : {size_t{1}, size_t{7}, size_t{256}, size_t{1024}}) {
    Hasher hasher;
    for (size_t at = 0; at < bytes.size(); at += piece) hasher.bytes(bytes.data() + at, std::min(piece, bytes.size() - at));
    EXPECT_EQ(hasher.key(), whole) << piece;
  }
}

TEST(Hasher, GoesOnFromACopyAndAfterAKey) {
  Hasher one;
  one.add("begin");
  const Key before = one.key();
  Hasher other = one;
  EXPECT_EQ(one.add(1).key(), other.add(1).key());
  EXPECT_NE(one.key(), before);
  EXPECT_NE(one.key(), Hasher().add("begin").add(2).key());
}

TEST(Hasher, KeepsTextsApartThatRunTogetherAlike) {
  EXPECT_NE(Hasher().add("ab").add("c").key(), Hasher().add("a").add("bc").key());
}

}  // namespace hash_test
}  // namespace knead
