#include <algorithm>

#include "io/mesh/assimp.h"
#include "io/module.h"

// Null but in tests, which are linked with all objects.
extern "C" __attribute__((weak)) void knead_read_assimp(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings,
                                                        knead::mesh::RawMesh& mesh);

namespace knead::mesh {

bool is_assimp_ending(std::string_view ending) {
  static constexpr std::string_view kEndings[] = {".gltf", ".glb", ".fbx", ".dae", ".3ds"};
  return std::find(std::begin(kEndings), std::end(kEndings), ending) != std::end(kEndings);
}

bool assimp_is_built_in() {
#if defined(KNEAD_ASSIMP_MODULE) || defined(KNEAD_ASSIMP_IS_LINKED)
  return true;
#else
  return false;
#endif
}

RawMesh read_assimp([[maybe_unused]] std::string_view bytes, const std::string& name, [[maybe_unused]] std::vector<std::string>& warnings) {
  RawMesh mesh;
#if defined(KNEAD_ASSIMP_MODULE)
  const auto load = [] { return reinterpret_cast<decltype(&knead_read_assimp)>(load_module("Assimp", KNEAD_ASSIMP_MODULE, "knead_read_assimp")); };
  static const auto read = knead_read_assimp ? &knead_read_assimp : load();  // a failed load is tried again
  read(bytes, name, warnings, mesh);
#elif defined(KNEAD_ASSIMP_IS_LINKED)
  knead_read_assimp(bytes, name, warnings, mesh);
#else
  throw Error(ErrorCode::kFile, in_file(name), "is read through Assimp, which this build of Knead lacks",
              "install libassimp-dev and build again, or use .obj or .ply");
#endif
  return mesh;
}

}  // namespace knead::mesh
