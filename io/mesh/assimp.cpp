// In libknead_assimp: a scene as Assimp reads it, to one mesh.
#include "io/mesh/assimp.h"

#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>

namespace knead::mesh {

namespace {

using Matrix = std::array<double, 16>;

Matrix to_matrix(const aiMatrix4x4& m) {
  return {m.a1, m.a2, m.a3, m.a4, m.b1, m.b2, m.b3, m.b4, m.c1, m.c2, m.c3, m.c4, m.d1, m.d2, m.d3, m.d4};
}

Matrix operator*(const Matrix& a, const Matrix& b) {
  Matrix product{};
  for (size_t i = 0; i < 4; ++i)
    for (size_t j = 0; j < 4; ++j)
      for (size_t k = 0; k < 4; ++k) product[4 * i + j] += a[4 * i + k] * b[4 * k + j];
  return product;
}

Vec3d placed(const Matrix& m, const aiVector3D& p) {
  const auto row = [&](size_t i) { return m[i] * p.x + m[i + 1] * p.y + m[i + 2] * p.z + m[i + 3]; };
  return {row(0), row(4), row(8)};
}

bool mirrors(const Matrix& m) {
  return dot(Vec3d{m[0], m[4], m[8]}, cross(Vec3d{m[1], m[5], m[9]}, Vec3d{m[2], m[6], m[10]})) < 0;
}

struct Flattened {
  const aiScene& scene;
  RawMesh& mesh;
  BadVertices bad{};
  ShortFaces short_faces{};
  size_t faces = 0;

  void add(const aiNode& node, const Matrix& parent) {
    const Matrix place = parent * to_matrix(node.mTransformation);
    for (unsigned m = 0; m < node.mNumMeshes; ++m) add(*scene.mMeshes[node.mMeshes[m]], place);
    for (unsigned c = 0; c < node.mNumChildren; ++c) add(*node.mChildren[c], place);
  }

  void add(const aiMesh& part, const Matrix& place) {
    const auto first = static_cast<uint32_t>(mesh.points.size());
    if (mesh.points.size() + part.mNumVertices > INT32_MAX) throw Error(ErrorCode::kInput, "has more than 2,147,483,647 vertices");
    for (unsigned v = 0; v < part.mNumVertices; ++v) {
      mesh.points.push_back(placed(place, part.mVertices[v]));
      bad.check(mesh.points.back(), mesh.points.size() - 1);
    }
    const bool turned = mirrors(place);
    for (unsigned f = 0; f < part.mNumFaces; ++f, ++faces) {
      const aiFace& face = part.mFaces[f];
      if (face.mNumIndices < 3) {
        short_faces.add(face.mNumIndices, faces, 0);
        continue;
      }
      for (unsigned k = 0; k < face.mNumIndices; ++k)
        mesh.topology.face_vertices.push_back(first + face.mIndices[turned ? face.mNumIndices - 1 - k : k]);
      mesh.close_face();
    }
  }
};

}  // namespace

}  // namespace knead::mesh

extern "C" void knead_read_assimp(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings, knead::mesh::RawMesh& mesh) {
  using namespace knead;
  Assimp::Importer importer;
  const aiScene* scene = importer.ReadFileFromMemory(bytes.data(), bytes.size(), 0, name.substr(name.rfind('.') + 1).c_str());
  if (!scene || !scene->mRootNode)
    throw Error(ErrorCode::kFile, in_file(name), std::string("Assimp cannot read it: ") + importer.GetErrorString(),
                "buffers must lie in the file itself (.glb, or a .gltf with embedded buffers); or export it as .obj or .ply");
  mesh::Flattened flattened{*scene, mesh};
  flattened.add(*scene->mRootNode, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
  flattened.bad.raise(name);
  flattened.short_faces.warn(warnings);
  mesh.weld = true;
}
