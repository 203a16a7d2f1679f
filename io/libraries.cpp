#include "io/libraries.h"

#include <embree3/rtcore_config.h>
#include <fmt/core.h>
#include <oneapi/tbb/version.h>
#include <openvdb/version.h>
#ifdef KNEAD_PICTURES
#include <png.h>
#endif

#include <nlohmann/json.hpp>

#include "kernels/simd_level.h"

namespace knead {

std::vector<std::pair<std::string, std::string>> library_versions() {
  return {{"OpenVDB", OPENVDB_LIBRARY_VERSION_STRING},
          {"oneTBB", TBB_runtime_version()},
          {"Embree", RTC_VERSION_STRING},
#ifdef KNEAD_PICTURES
          {"libpng", png_get_libpng_ver(nullptr)},
#endif
          {"nlohmann", fmt::format("{}.{}.{}", NLOHMANN_JSON_VERSION_MAJOR, NLOHMANN_JSON_VERSION_MINOR, NLOHMANN_JSON_VERSION_PATCH)},
          {"fmt", fmt::format("{}.{}.{}", FMT_VERSION / 10000, FMT_VERSION / 100 % 100, FMT_VERSION % 100)}};
}

std::string simd_level() {
  const std::vector<SimdLevel> levels = simd_levels();
  std::string all;
  for (const SimdLevel level : levels) all += fmt::format("{}{}", all.empty() ? "" : ", ", name_of(level));
  return fmt::format("{} (this build and processor have {})", name_of(levels.back()), all);
}

}  // namespace knead
