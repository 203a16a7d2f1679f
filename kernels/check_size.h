// The check that tables of one node belong to the tables of another.
#pragma once
#include <cstddef>
#include <string>

#include "graph/error.h"

namespace knead {

inline void require_size(size_t is, size_t should_be, const char* kernel, const char* what, const char* of_what) {
  if (is == should_be) return;
  throw Error(ErrorCode::kInput, std::string(kernel) + ": " + std::to_string(is) + " " + what + " for " + std::to_string(should_be) + " " + of_what,
              "connect ports that come from the same build_tets");
}

}  // namespace knead
