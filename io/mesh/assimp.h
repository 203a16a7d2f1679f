// Inside io/mesh only: formats that are read through Assimp (glTF, FBX, COLLADA, 3DS). Its library takes 30 ms to load, so what needs it stands in a module,
// libknead_assimp, that is loaded when such a file is first read. In a static build it is linked like the rest; without KNEAD_ASSIMP it is not there.
#pragma once
#include "graph/api.h"
#include "io/mesh/raw_mesh.h"

namespace knead::mesh {

bool is_assimp_ending(std::string_view ending);  // with its point, in lower case
bool assimp_is_built_in();

// The polygons of every mesh of the scene, each where its node places it. Formats of this kind split vertices where normals or texture coordinates differ, so
// they are welded; names, materials, normals and texture coordinates stay behind. Read from memory alone: buffers in other files are not looked for.
RawMesh read_assimp(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings);

}  // namespace knead::mesh

// The module's only door.
extern "C" KNEAD_API void knead_read_assimp(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings,
                                            knead::mesh::RawMesh& mesh);
