// Stanford PLY, writing: binary little endian, or ascii on request. float x y z where the surface has no placement, else double; normals and texture
// coordinates by vertex where no vertex has two of them; texture coordinates with seams as the face list `texcoord`, as MeshLab writes them. Normals
// with sharp edges, groups, objects and materials have no place in PLY. Numbers that another program put into the file for itself follow the known ones.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "io/mesh/ply.h"

namespace knead::mesh {

namespace {

class PlyWriter {
 public:
  PlyWriter(const Surface& surface, const WriteMeshOptions& options, std::vector<std::string>& notes)
      : surface_(surface),
        topology_(*surface.topology),
        ascii_(options.ascii),
        text_(options.precision),
        shading_(normals_to_write(surface, options)) {
    static const MeshAttributes kNone;
    attributes_ = surface.attributes ? surface.attributes.get() : &kNone;
    wide_ = !surface.placement.is_identity();
    choose_normals(notes);
    choose_texture();
    choose_colours();
    choose_own(attributes_->vertex_properties, surface.vertices(), vertex_own_);
    choose_own(attributes_->face_properties, topology_.faces(), face_own_);
    if (!attributes_->groups.empty() || !attributes_->objects.empty() || !attributes_->materials.empty())
      notes.push_back("PLY has no place for groups, objects and materials; left out");
  }

  std::string write() {
    header();
    if (ascii_) {
      ascii_body();
      return text_.take();
    }
    std::string out = text_.take();
    binary_body(out);
    return out;
  }

 private:
  void choose_normals(std::vector<std::string>& notes) {
    if (shading_.corner_normal.size() != topology_.corners() || shading_.normals.empty()) return;
    vertex_normal_ = by_vertex(topology_, shading_.corner_normal, surface_.vertices(), [&](int32_t i, int32_t j) {
      const Vec3f &a = shading_.normals[static_cast<size_t>(i)], &b = shading_.normals[static_cast<size_t>(j)];
      return a.x == b.x && a.y == b.y && a.z == b.z;
    });
    if (vertex_normal_.empty())
      notes.push_back("PLY has one normal a vertex, and this mesh has sharp edges or faces without normals: normals left out");
  }

  void choose_texture() {
    const auto& pool = attributes_->texture_coordinates;
    if (attributes_->corner_texture.size() != topology_.corners() || pool.empty()) return;
    vertex_texture_ = by_vertex(topology_, attributes_->corner_texture, surface_.vertices(),
                                [&](int32_t i, int32_t j) { return pool[static_cast<size_t>(i)] == pool[static_cast<size_t>(j)]; });
    corner_texture_ = vertex_texture_.empty();
  }

  void choose_colours() {
    const auto& colours = attributes_->vertex_colours;
    coloured_ = colours.size() == surface_.vertices() && !colours.empty();
    if (!coloured_) return;
    byte_colours_ = true;
    for (const auto& colour : colours)
      for (size_t k = 0; k < 4; ++k) {
        alpha_ = alpha_ || (k == 3 && colour[k] != 1);
        byte_colours_ = byte_colours_ && byte_of(colour[k]) >= 0;
      }
  }

  struct Own {
    const MeshProperty* property;
    ply::Type type;
  };
  static void choose_own(const std::vector<MeshProperty>& properties, size_t count, std::vector<Own>& chosen) {
    for (const MeshProperty& property : properties) {
      std::optional<ply::Type> type = ply::type_named(property.type);
      if (property.values.size() != count) continue;
      for (const double value : property.values)
        if (!type || !ply::fits(*type, value)) type = ply::Type::kDouble;  // 300 in a uchar, as text files have it
      chosen.push_back({&property, *type});
    }
  }

  // The byte that reads back as exactly this value, or -1.
  static int byte_of(float v) {
    const double scaled = std::round(static_cast<double>(v) * 255);
    return scaled >= 0 && scaled <= 255 && static_cast<float>(scaled / 255) == v ? static_cast<int>(scaled) : -1;
  }

  void header() {
    const char* real = wide_ ? "double" : "float";
    text_.text("ply\nformat ").text(ascii_ ? "ascii" : "binary_little_endian").text(" 1.0\ncomment Written by Knead\nelement vertex ");
    text_.whole(static_cast<int64_t>(surface_.vertices())).text("\n");
    for (const char* name : {"x", "y", "z"}) property(real, name);
    if (!vertex_normal_.empty())
      for (const char* name : {"nx", "ny", "nz"}) property("float", name);
    if (!vertex_texture_.empty())
      for (const char* name : {"s", "t"}) property("float", name);
    if (coloured_) {
      for (const char* name : {"red", "green", "blue"}) property(byte_colours_ ? "uchar" : "float", name);
      if (alpha_) property(byte_colours_ ? "uchar" : "float", "alpha");
    }
    for (const Own& own : vertex_own_) property(ply::kTypeNames[static_cast<size_t>(own.type)], own.property->name);
    text_.text("element face ").whole(static_cast<int64_t>(topology_.faces())).text("\n");
    uint32_t largest = 0;
    for (size_t f = 0; f < topology_.faces(); ++f) largest = std::max(largest, topology_.face_offsets[f + 1] - topology_.face_offsets[f]);
    long_faces_ = largest * (corner_texture_ ? 2 : 1) > 255;
    text_.text("property list ").text(long_faces_ ? "uint" : "uchar").text(" int vertex_indices\n");
    if (corner_texture_) text_.text("property list ").text(long_faces_ ? "uint" : "uchar").text(" float texcoord\n");
    for (const Own& own : face_own_) property(ply::kTypeNames[static_cast<size_t>(own.type)], own.property->name);
    text_.text("end_header\n");
  }

  void property(std::string_view type, std::string_view name) { text_.text("property ").text(type).text(" ").text(name).text("\n"); }

  Vec3f normal_of(size_t vertex) const {
    return vertex_normal_[vertex] < 0 ? Vec3f{0, 0, 0} : shading_.normals[static_cast<size_t>(vertex_normal_[vertex])];
  }
  std::array<float, 2> texture_of(int32_t index) const {
    return index < 0 ? std::array<float, 2>{0, 0} : attributes_->texture_coordinates[static_cast<size_t>(index)];
  }

  void ascii_own(const std::vector<Own>& all, size_t index) {
    for (const Own& own : all) {
      const double value = own.property->values[index];
      text_.text(" ");
      if (own.type == ply::Type::kFloat)
        text_.real(static_cast<float>(value));
      else if (own.type == ply::Type::kDouble)
        text_.real(value);
      else
        text_.whole(static_cast<int64_t>(value));
    }
  }

  void ascii_body() {
    for (size_t i = 0; i < surface_.vertices(); ++i) {
      text_.point(surface_, i);
      if (!vertex_normal_.empty()) text_.text(" ").vector(normal_of(i));
      if (!vertex_texture_.empty()) text_.text(" ").real(texture_of(vertex_texture_[i])[0]).text(" ").real(texture_of(vertex_texture_[i])[1]);
      for (size_t k = 0; coloured_ && k < (alpha_ ? 4u : 3u); ++k) {
        const float value = attributes_->vertex_colours[i][k];
        byte_colours_ ? text_.text(" ").whole(byte_of(value)) : text_.text(" ").real(value);
      }
      ascii_own(vertex_own_, i);
      text_.text("\n");
    }
    for (size_t f = 0; f < topology_.faces(); ++f) {
      const uint32_t first = topology_.face_offsets[f], last = topology_.face_offsets[f + 1];
      text_.whole(last - first);
      for (uint32_t c = first; c < last; ++c) text_.text(" ").whole(topology_.face_vertices[c]);
      if (corner_texture_) {
        text_.text(" ").whole(2 * int64_t{last - first});
        for (uint32_t c = first; c < last; ++c)
          for (float part : texture_of(attributes_->corner_texture[c])) text_.text(" ").real(part);
      }
      ascii_own(face_own_, f);
      text_.text("\n");
    }
  }

  template <class T>
  static void put(std::string& out, T value) {
    char raw[sizeof(T)];
    std::memcpy(raw, &value, sizeof(T));
    if constexpr (std::endian::native == std::endian::big) std::reverse(raw, raw + sizeof(T));
    out.append(raw, sizeof(T));
  }
  template <class F>
  static void put_vector(std::string& out, const Vec3<F>& v) {
    put(out, v.x), put(out, v.y), put(out, v.z);
  }
  static void put_own(std::string& out, const std::vector<Own>& all, size_t index) {
    for (const Own& own : all) {
      const double value = own.property->values[index];
      switch (own.type) {
        case ply::Type::kInt8: put(out, static_cast<int8_t>(value)); break;
        case ply::Type::kUint8: put(out, static_cast<uint8_t>(value)); break;
        case ply::Type::kInt16: put(out, static_cast<int16_t>(value)); break;
        case ply::Type::kUint16: put(out, static_cast<uint16_t>(value)); break;
        case ply::Type::kInt32: put(out, static_cast<int32_t>(value)); break;
        case ply::Type::kUint32: put(out, static_cast<uint32_t>(value)); break;
        case ply::Type::kFloat: put(out, static_cast<float>(value)); break;
        case ply::Type::kDouble: put(out, value); break;
      }
    }
  }
  void put_count(std::string& out, uint32_t n) const {
    if (long_faces_)
      put(out, n);
    else
      put(out, static_cast<uint8_t>(n));
  }

  void binary_body(std::string& out) {
    const auto points = surface_.points.host();
    out.reserve(out.size() + points.size() * (wide_ ? 64 : 52) + topology_.faces() * 8 + topology_.corners() * (corner_texture_ ? 12 : 4));
    for (size_t i = 0; i < points.size(); ++i) {
      if (wide_)
        put_vector(out, surface_.placement.apply(to_double(points[i])));
      else
        put_vector(out, points[i]);
      if (!vertex_normal_.empty()) put_vector(out, normal_of(i));
      if (!vertex_texture_.empty())
        for (float part : texture_of(vertex_texture_[i])) put(out, part);
      for (size_t k = 0; coloured_ && k < (alpha_ ? 4u : 3u); ++k) {
        const float value = attributes_->vertex_colours[i][k];
        if (byte_colours_)
          put(out, static_cast<uint8_t>(byte_of(value)));
        else
          put(out, value);
      }
      put_own(out, vertex_own_, i);
    }
    for (size_t f = 0; f < topology_.faces(); ++f) {
      const uint32_t first = topology_.face_offsets[f], last = topology_.face_offsets[f + 1];
      put_count(out, last - first);
      for (uint32_t c = first; c < last; ++c) put(out, static_cast<int32_t>(topology_.face_vertices[c]));
      if (corner_texture_) put_count(out, 2 * (last - first));
      for (uint32_t c = first; corner_texture_ && c < last; ++c)
        for (float part : texture_of(attributes_->corner_texture[c])) put(out, part);
      put_own(out, face_own_, f);
    }
  }

  const Surface& surface_;
  const MeshTopology& topology_;
  const MeshAttributes* attributes_ = nullptr;
  bool ascii_;
  TextWriter text_;
  CornerNormals shading_;
  std::vector<Own> vertex_own_, face_own_;
  std::vector<int32_t> vertex_normal_, vertex_texture_;
  bool corner_texture_ = false, coloured_ = false, alpha_ = false, byte_colours_ = false, wide_ = false, long_faces_ = false;
};

}  // namespace

std::string write_ply(const Surface& surface, const WriteMeshOptions& options, std::vector<std::string>& notes) {
  return PlyWriter(surface, options, notes).write();
}

}  // namespace knead::mesh
