// What this build stands on, for `knead info`.
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "graph/api.h"

namespace knead {

KNEAD_API std::vector<std::pair<std::string, std::string>> library_versions();  // name, version
KNEAD_API std::string simd_level();                                             // "avx2 (of scalar, baseline, avx2)"

}  // namespace knead
