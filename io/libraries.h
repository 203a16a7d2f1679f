// What this build stands on, for `knead info`.
#pragma once
#include <string>
#include <utility>
#include <vector>

namespace knead {

std::vector<std::pair<std::string, std::string>> library_versions();  // name, version
std::string simd_level();                                             // "avx2 (of scalar, baseline, avx2)"

}  // namespace knead
