#include <fmt/format.h>

#include "app/common.h"
#include "io/libraries.h"

namespace knead::app {

int show_info() {
  fmt::print("knead {} ({} build)\n\nexecutors\n", KNEAD_VERSION, KNEAD_BUILD_TYPE);
  bool best = true;
  for (const ExecutorChoice& choice : executor_choices()) {
    fmt::print("  {:<12} {}{}\n", choice.name, choice.description, choice.present && best ? " (--device auto)" : "");
    best = best && !choice.present;
  }
  fmt::print("  {:<12} {}\n\nlibraries\n", "SIMD", simd_level());
  for (const auto& [name, version] : library_versions()) fmt::print("  {:<12} {}\n", name, version);
  return kGood;
}

}  // namespace knead::app
