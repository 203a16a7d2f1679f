// Stanford PLY, reading: ascii, binary little and big endian, any order of elements and properties. Kept: x y z, nx ny nz, colours (whole numbers or
// floats), texture coordinates by vertex (s t, u v, texture_u texture_v) or by face corner (a list `texcoord`, as MeshLab writes), and faces of any
// number of corners, or strips of triangles. Single numbers of vertices and faces that mean nothing here (quality, id, flags) are carried along for
// write_ply; other lists and elements are stepped over with a warning. No PLY library is packaged for Debian.
#include <algorithm>
#include <bit>
#include <utility>

#include "io/mesh/ply_values.h"

namespace knead::mesh {

namespace {

using namespace ply;

template <class Values>
class PlyBody {
 public:
  PlyBody(Values& values, const Header& header, const std::string& name, size_t body_bytes)
      : values_(values), header_(header), name_(name), body_bytes_(body_bytes) {}

  RawMesh read(std::vector<std::string>& warnings) {
    for (const Element& element : header_.elements) check_size(element);
    try {
      for (const Element& element : header_.elements) read_element(element);
      values_.finish();
      check_largest();
    } catch (const Error& error) {
      values_.explain(error);
      throw;
    }
    bad_.raise(name_);
    finish(warnings);
    return std::move(mesh_);
  }

 private:
  // Before anything is allocated: a count that the file's size cannot hold is an error, not a request for memory.
  void check_size(const Element& element) const {
    size_t least = 0;
    for (const Property& p : element.properties) least += Values::least_bytes(p.list ? *p.list : p.type);
    if (element.properties.empty() && element.count > 0)
      throw Error(ErrorCode::kFile, in_file(name_), "the element '" + element.name + "' has no properties");
    // The last line of a text file may lack its end.
    if (element.count > 0 && element.count > (body_bytes_ + 1) / least)
      throw Error(ErrorCode::kFile, in_file(name_),
                  "the header announces " + std::to_string(element.count) + " of '" + element.name + "', but the " + std::to_string(body_bytes_) +
                      " bytes that follow cannot hold them",
                  "the file is damaged or cut short; export or copy it again");
    if (element.count > INT32_MAX) throw Error(ErrorCode::kFile, in_file(name_), "has more than 2,147,483,647 of '" + element.name + "'");
  }

  size_t list_length(const Property& property) {
    const int64_t length = values_.integer(*property.list);
    if (length < 0) values_.fail("a list of negative length");
    if (static_cast<size_t>(length) > body_bytes_ ||
        static_cast<size_t>(length) * Values::least_bytes(property.type) > std::max(values_.left(), size_t{1}))
      values_.fail("a list of " + std::to_string(length) + " entries, more than the file holds");
    return static_cast<size_t>(length);
  }

  void skip(const Property& property) {
    if (!property.list) return values_.skip(property.type);
    for (size_t n = list_length(property); n > 0; --n) values_.skip(property.type);
  }

  void read_element(const Element& element) {
    if (element.name == "vertex") return read_vertices(element);
    if (element.name == "face") return read_faces(element);
    if (element.name == "tristrips") return read_strips(element);
    if (element.count > 0) left_out_.push_back("the element '" + element.name + "'");
    for (size_t i = 0; i < element.count; ++i) {
      values_.begin(element, i);
      for (const Property& p : element.properties) skip(p);
      values_.end();
    }
  }

  // For each property of the element the place of its numbers in `kept`, or null where they have a meaning or are lists.
  template <class HasMeaning>
  std::vector<std::vector<double>*> own_numbers(const Element& element, std::vector<MeshProperty>& kept, HasMeaning has_meaning) {
    std::vector<size_t> places;
    for (const Property& p : element.properties) {
      places.push_back(SIZE_MAX);
      if (has_meaning(p) || element.count == 0) continue;
      if (p.list) {
        left_out_.push_back("the list '" + p.name + "' of '" + element.name + "'");
      } else {
        places.back() = kept.size();
        kept.push_back({p.name, kTypeNames[static_cast<size_t>(p.type)], {}});
        kept.back().values.reserve(element.count);
      }
    }
    std::vector<std::vector<double>*> numbers;
    for (const size_t place : places) numbers.push_back(place == SIZE_MAX ? nullptr : &kept[place].values);
    return numbers;
  }

  void read_vertices(const Element& element) {
    if (!mesh_.points.empty()) throw Error(ErrorCode::kFile, in_file(name_), "has two vertex elements");
    if (!element.has(Use::kPosition, 3)) throw Error(ErrorCode::kFile, in_file(name_), "its vertices have no x, y and z");
    MeshAttributes& attributes = mesh_.attributes;
    vertex_normals_ = element.has(Use::kNormal, 3), vertex_texture_ = element.has(Use::kTexture, 2);
    const bool colours = element.has(Use::kColour, 3);
    const auto has_meaning = [&](const Property& p) {
      return p.use == Use::kPosition || (p.use == Use::kNormal && vertex_normals_) || (p.use == Use::kTexture && vertex_texture_) ||
             (p.use == Use::kColour && colours);
    };
    mesh_.points.resize(element.count);
    if (vertex_normals_) attributes.normals.resize(element.count);
    if (vertex_texture_) attributes.texture_coordinates.resize(element.count);
    if (colours) attributes.vertex_colours.assign(element.count, {0, 0, 0, 1});
    const auto own = own_numbers(element, attributes.vertex_properties, has_meaning);
    if (read_vertex_rows(element, own, has_meaning)) return;
    for (size_t i = 0; i < element.count; ++i) {
      values_.begin(element, i);
      for (size_t k = 0; k < element.properties.size(); ++k) {
        const Property& p = element.properties[k];
        if (p.use == Use::kPosition)
          mesh_.points[i][p.part] = values_.number(p.type);
        else if (own[k])
          own[k]->push_back(own_number(p.type));
        else if (has_meaning(p))
          keep_attribute(p, i, values_.number(p.type));
        else
          skip(p);
      }
      values_.end();
      bad_.check(mesh_.points[i], i, values_.line());
    }
  }

  // One property of all vertices after the other, where the file allows it.
  template <class HasMeaning>
  bool read_vertex_rows(const Element& element, const std::vector<std::vector<double>*>& own, HasMeaning has_meaning) {
    if constexpr (Values::kInRows) {
      const Rows rows = values_.rows(element);
      if (!rows.first) return false;
      size_t offset = 0;
      for (size_t k = 0; k < element.properties.size(); ++k) {
        const Property& p = element.properties[k];
        if (p.use == Use::kPosition)
          Values::column(rows, offset, p.type, [&, part = p.part](size_t i, double v) { mesh_.points[i][part] = v; });
        else if (own[k])
          Values::column(rows, offset, p.type, [&numbers = *own[k]](size_t, double v) { numbers.push_back(v); });
        else if (has_meaning(p))
          Values::column(rows, offset, p.type, [&](size_t i, double v) { keep_attribute(p, i, v); });
        offset += kTypeBytes[static_cast<size_t>(p.type)];
      }
      for (size_t i = 0; i < element.count; ++i) bad_.check(mesh_.points[i], i);
      return true;
    } else {
      return false;
    }
  }

  // In text a float has whatever digits its writer liked: the float that they mean is what is written again.
  double own_number(Type type) {
    const double value = values_.number(type);
    const auto narrow = static_cast<float>(value);
    return type == Type::kFloat && std::isfinite(narrow) ? static_cast<double>(narrow) : value;
  }

  void keep_attribute(const Property& p, size_t vertex, double value) {
    MeshAttributes& attributes = mesh_.attributes;
    const auto part = static_cast<size_t>(p.part);
    if (p.use == Use::kNormal) attributes.normals[vertex][p.part] = numbers_.clean(value);
    if (p.use == Use::kTexture) attributes.texture_coordinates[vertex][part] = numbers_.clean(value);
    if (p.use == Use::kColour)
      attributes.vertex_colours[vertex][part] = static_cast<float>(numbers_.clean(value) / kWholeColour[static_cast<size_t>(p.type)]);
  }

  void read_faces(const Element& element) {
    if (faces_read_) throw Error(ErrorCode::kFile, in_file(name_), "has two face elements");
    if (!element.has(Use::kCorners, 1) && element.count > 0) throw Error(ErrorCode::kFile, in_file(name_), "its faces have no list 'vertex_indices'");
    faces_read_ = element.count > 0;
    MeshTopology& topology = mesh_.topology;
    topology.face_offsets.reserve(topology.face_offsets.size() + element.count);
    topology.face_vertices.reserve(topology.face_vertices.size() + 3 * element.count);
    const auto own = own_numbers(element, mesh_.attributes.face_properties, [](const Property& p) { return p.use != Use::kNone; });
    const bool textured = element.has(Use::kCornerTexture, 1);
    for (size_t i = 0; i < element.count; ++i) {
      values_.begin(element, i);
      const size_t first = topology.corners();
      corner_numbers_.clear();
      for (size_t k = 0; k < element.properties.size(); ++k) {
        const Property& p = element.properties[k];
        if (p.use == Use::kCorners)
          read_corners(p, i);
        else if (p.use == Use::kCornerTexture)
          read_corner_texture(p);
        else if (own[k])
          own[k]->push_back(own_number(p.type));
        else
          skip(p);
      }
      values_.end();
      if (const size_t corners = topology.corners() - first; corners < 3) {
        short_faces_.add(corners, i, values_.line());
        topology.face_vertices.resize(first);
        for (MeshProperty& p : mesh_.attributes.face_properties) p.values.pop_back();
      } else {
        mesh_.close_face();
        if (textured) keep_corner_texture(first);
      }
    }
  }

  void read_corners(const Property& property, size_t face) {
    std::vector<uint32_t>& corners = mesh_.topology.face_vertices;
    const size_t n = list_length(property), first = corners.size();
    corners.resize(first + n);
    uint32_t* to = corners.data() + first;
    values_.integers(property.type, n, [&](int64_t v) { *to++ = corner(v, "face", face); });
    if (mesh_.topology.corners() > INT32_MAX) values_.fail("the mesh has more than 2,147,483,647 corners");
  }

  [[noreturn]] void fail_corner(int64_t v, const char* kind, size_t face) const {
    values_.fail(std::string(kind) + " " + std::to_string(face) + " refers to vertex " + std::to_string(v) + "; PLY counts from 0");
  }

  uint32_t corner(int64_t v, const char* kind, size_t face) {
    if (v < 0 || v > INT32_MAX) fail_corner(v, kind, face);
    if (v > largest_.vertex) largest_ = {v, face, values_.line(), kind};
    return static_cast<uint32_t>(v);
  }

  // A strip's corner makes a triangle with the two before it, every other one turned round; -1 ends the strip. Triangles with a repeated corner only lead to
  // the next ones.
  void read_strips(const Element& element) {
    if (!element.has(Use::kCorners, 1) && element.count > 0)
      throw Error(ErrorCode::kFile, in_file(name_), "its strips have no list 'vertex_indices'");
    for (size_t i = 0; i < element.count; ++i) {
      values_.begin(element, i);
      for (const Property& p : element.properties) p.use == Use::kCorners ? read_strip(p, i) : skip(p);
      values_.end();
    }
    strip_faces_ = mesh_.topology.faces() > 0;
  }

  void read_strip(const Property& property, size_t strip) {
    const int64_t end = property.type == Type::kUint32 ? UINT32_MAX : property.type == Type::kUint16 ? UINT16_MAX : -1;
    std::vector<uint32_t>& corners = mesh_.topology.face_vertices;
    int64_t last[2] = {-1, -1};
    bool turned = false;
    for (size_t n = list_length(property); n > 0; --n) {
      const int64_t v = values_.integer(property.type);
      if (v == -1 || v == end) {
        last[0] = last[1] = -1, turned = false;
        continue;
      }
      const size_t first = corners.size();
      corner(v, "strip", strip);
      if (last[0] >= 0) {
        for (const int64_t corner : {last[turned], last[!turned], v}) corners.push_back(static_cast<uint32_t>(corner));
        turned = !turned;
        if (last[0] == last[1] || v == last[0] || v == last[1])
          corners.resize(first);
        else
          mesh_.close_face();
      }
      last[0] = last[1], last[1] = v;
    }
    if (corners.size() > INT32_MAX) values_.fail("the mesh has more than 2,147,483,647 corners");
  }

  // 2 numbers per corner; equal neighbours in the list of one face are not joined, seams stay as they are.
  void read_corner_texture(const Property& property) {
    corner_numbers_.clear();
    for (size_t n = list_length(property); n > 0; --n) corner_numbers_.push_back(numbers_.clean(values_.number(property.type)));
  }

  void keep_corner_texture(size_t first) {
    const size_t corners = mesh_.topology.corners() - first;
    face_texture_.resize(first, -1);
    if (corner_numbers_.size() == 2 * corners)
      for (size_t k = 0; k < corners; ++k) {
        face_texture_.push_back(static_cast<int32_t>(corner_pool_.size()));
        corner_pool_.push_back({corner_numbers_[2 * k], corner_numbers_[2 * k + 1]});
      }
    face_texture_.resize(mesh_.topology.corners(), -1);
  }

  void check_largest() const {
    if (mesh_.topology.faces() == 0 || static_cast<size_t>(largest_.vertex) < mesh_.points.size()) return;
    throw Error(ErrorCode::kFile, in_file(name_, largest_.line),
                std::string(largest_.kind) + " " + std::to_string(largest_.face) + " refers to vertex " + std::to_string(largest_.vertex) +
                    ", but the file has only " + std::to_string(mesh_.points.size()) + " (counted from 0)",
                "the file is damaged; export it again");
  }

  void finish(std::vector<std::string>& warnings) {
    MeshTopology& topology = mesh_.topology;
    MeshAttributes& attributes = mesh_.attributes;
    if (const size_t left = values_.left(); left != SIZE_MAX && left > 0) {
      if (header_.unknown_lines.count() > 0)
        throw Error(ErrorCode::kFile, in_file(name_, header_.unknown_lines.first_line()),
                    shown(header_.unknown_lines.first_text()) + " is no PLY header statement, and without it " + std::to_string(left) +
                        " bytes of the file belong to nothing",
                    "mend the line, or begin it with 'comment' to leave it out");
      warnings.push_back(counted(left, "byte follows", "bytes follow") + " the mesh; left out");
    }
    if (strip_faces_ && !attributes.face_properties.empty()) {
      left_out_.push_back("the numbers of faces, which strips do not have,");
      attributes.face_properties.clear();
    }
    const std::vector<int32_t> corners(topology.face_vertices.begin(), topology.face_vertices.end());
    if (vertex_normals_) attributes.corner_normal = corners;
    if (vertex_texture_) attributes.corner_texture = corners;
    if (!corner_pool_.empty()) {
      face_texture_.resize(topology.corners(), -1);
      attributes.texture_coordinates = std::move(corner_pool_);
      attributes.corner_texture = std::move(face_texture_);
    }
    numbers_.warn("normals, texture coordinates and colours", warnings);
    header_.unknown_lines.warn("header line that is no PLY statement", "header lines that are no PLY statements", warnings);
    if (!header_.taken_for_corners.empty()) warnings.push_back("the list '" + header_.taken_for_corners + "' is taken for the corners of the faces");
    short_faces_.warn(warnings);
    if (!left_out_.empty()) warnings.push_back(listed(left_out_) + " left out");
  }

  struct Reference {
    int64_t vertex = 0;
    size_t face = 0;
    int line = 0;
    const char* kind = "face";
  };

  Values& values_;
  const Header& header_;
  const std::string& name_;
  size_t body_bytes_;
  RawMesh mesh_;
  BadVertices bad_;
  AttributeNumbers numbers_;
  Reference largest_;
  std::vector<float> corner_numbers_;
  std::vector<std::array<float, 2>> corner_pool_;
  std::vector<int32_t> face_texture_;
  std::vector<std::string> left_out_;
  ShortFaces short_faces_;
  bool vertex_texture_ = false, vertex_normals_ = false, faces_read_ = false, strip_faces_ = false;
};

// After a header whose lines end with \r alone, a body that begins with the byte of \n: 1, else 0.
size_t first_byte_taken_for_line_end(std::string_view bytes, const TextReader& text) {
  const size_t first_end = bytes.find_first_of("\r\n"), after = text.offset_after_line();
  const bool lone = first_end != std::string_view::npos && bytes[first_end] == '\r' && bytes.substr(first_end + 1, 1) != "\n";
  return lone && after >= 2 && bytes.substr(after - 2, 2) == "\r\n" ? 1 : 0;
}

}  // namespace

RawMesh read_ply(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  static_assert(std::endian::native == std::endian::little || std::endian::native == std::endian::big);
  TextReader text(bytes, name);
  const Header header = read_header(text);
  const std::string_view body = bytes.substr(std::min(bytes.size(), text.offset_after_line() - first_byte_taken_for_line_end(bytes, text)));
  if (header.encoding == Encoding::kAscii) {
    AsciiValues values(text);
    return PlyBody<AsciiValues>(values, header, name, body.size()).read(warnings);
  }
  if ((header.encoding == Encoding::kBig) == (std::endian::native == std::endian::big)) {
    BinaryValues<false> values(body, name);
    return PlyBody<BinaryValues<false>>(values, header, name, body.size()).read(warnings);
  }
  BinaryValues<true> values(body, name);
  return PlyBody<BinaryValues<true>>(values, header, name, body.size()).read(warnings);
}

}  // namespace knead::mesh
