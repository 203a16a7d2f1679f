// Stanford PLY, reading: ascii, binary little and big endian, any order of elements and properties. Kept: x y z, nx ny nz, colours (whole numbers or
// floats), texture coordinates by vertex (s t, u v, texture_u texture_v) or by face corner (a list `texcoord`, as MeshLab writes), and faces of any
// number of corners. Other properties and elements are stepped over. No PLY library is packaged for Debian.
#include "io/mesh/ply.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace knead::mesh {

namespace {

using namespace ply;

int64_t whole(double v) {
  return v > -9e15 && v < 9e15 ? static_cast<int64_t>(v) : -1;
}

// Values one after the other, whatever the encoding.
class AsciiValues {
 public:
  explicit AsciiValues(TextReader& text) : text_(text) {}
  void begin(const Element& element, size_t index) {
    if (!text_.next_full_line())
      text_.fail("the file ends at " + element.name + " " + std::to_string(index) + " of " + std::to_string(element.count),
                 "the file is damaged or cut short");
  }
  void end() {
    if (!text_.line_is_over()) text_.fail("the line has more values than the header announces");
  }
  double number(Type) { return text_.number("a value"); }
  int64_t integer(Type type) {
    if (type != Type::kFloat && type != Type::kDouble) return text_.integer("a whole number");
    return whole(text_.number("a whole number"));
  }
  void skip(Type) { text_.number("a value"); }
  size_t left() const { return SIZE_MAX; }
  static size_t least_bytes(Type) { return 2; }
  int line() const { return text_.line(); }
  [[noreturn]] void fail(const std::string& message) const { text_.fail(message, "the file is damaged"); }

 private:
  TextReader& text_;
};

template <bool kSwap>
class BinaryValues {
 public:
  BinaryValues(std::string_view bytes, const std::string& name) : at_(bytes.data()), end_(at_ + bytes.size()), name_(name) {}
  void begin(const Element& element, size_t index) { element_ = &element, index_ = index; }
  void end() {}
  double number(Type type) {
    switch (type) {
      case Type::kFloat: return take<float>();
      case Type::kDouble: return take<double>();
      default: return static_cast<double>(integer(type));
    }
  }
  int64_t integer(Type type) {
    switch (type) {
      case Type::kInt8: return take<int8_t>();
      case Type::kUint8: return take<uint8_t>();
      case Type::kInt16: return take<int16_t>();
      case Type::kUint16: return take<uint16_t>();
      case Type::kInt32: return take<int32_t>();
      case Type::kUint32: return take<uint32_t>();
      case Type::kFloat: return whole(take<float>());
      case Type::kDouble: return whole(take<double>());
    }
    return 0;
  }
  void skip(Type type) {
    const size_t bytes = kTypeBytes[static_cast<size_t>(type)];
    if (left() < bytes) fail_short();
    at_ += bytes;
  }
  size_t left() const { return static_cast<size_t>(end_ - at_); }
  static size_t least_bytes(Type type) { return kTypeBytes[static_cast<size_t>(type)]; }
  int line() const { return 0; }
  [[noreturn]] void fail(const std::string& message) const {
    throw Error(ErrorCode::kFile, in_file(name_), place() + message, "the file is damaged or its header does not fit its data");
  }

 private:
  std::string place() const {
    return element_ ? element_->name + " " + std::to_string(index_) + " of " + std::to_string(element_->count) + ": " : "";
  }
  [[noreturn]] void fail_short() const {
    throw Error(ErrorCode::kFile, in_file(name_), place() + "the file ends here", "the file is damaged or cut short; export or copy it again");
  }
  template <class T>
  T take() {
    if (left() < sizeof(T)) fail_short();
    char raw[sizeof(T)];
    std::memcpy(raw, at_, sizeof(T));
    if constexpr (kSwap) std::reverse(raw, raw + sizeof(T));
    at_ += sizeof(T);
    return std::bit_cast<T>(raw);
  }

  const char *at_, *end_;
  std::string name_;
  const Element* element_ = nullptr;
  size_t index_ = 0;
};

template <class Values>
class PlyBody {
 public:
  PlyBody(Values& values, const Header& header, const std::string& name, size_t body_bytes)
      : values_(values), header_(header), name_(name), body_bytes_(body_bytes) {}

  RawMesh read(std::vector<std::string>& warnings) {
    for (const Element& element : header_.elements) check_size(element);
    for (const Element& element : header_.elements) {
      if (element.name == "vertex")
        read_vertices(element);
      else if (element.name == "face")
        read_faces(element);
      else
        step_over(element);
    }
    bad_.raise(name_);
    if (values_.left() != SIZE_MAX && values_.left() > 0)
      warnings.push_back(counted(values_.left(), "byte follows", "bytes follow") + " the mesh; left out");
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

  void step_over(const Element& element) {
    if (element.name == "tristrips" && element.count > 0)
      throw Error(ErrorCode::kFile, in_file(name_), "stores its faces as triangle strips", "export it with plain faces");
    for (size_t i = 0; i < element.count; ++i) {
      values_.begin(element, i);
      for (const Property& p : element.properties) skip(p);
      values_.end();
    }
  }

  void read_vertices(const Element& element) {
    if (!mesh_.points.empty()) throw Error(ErrorCode::kFile, in_file(name_), "has two vertex elements");
    if (!element.has(Use::kPosition, 3)) throw Error(ErrorCode::kFile, in_file(name_), "its vertices have no x, y and z");
    MeshAttributes& attributes = mesh_.attributes;
    const bool normals = element.has(Use::kNormal, 3), texture = element.has(Use::kTexture, 2), colours = element.has(Use::kColour, 3);
    mesh_.points.resize(element.count);
    if (normals) attributes.normals.resize(element.count);
    if (texture) attributes.texture_coordinates.resize(element.count);
    if (colours) attributes.vertex_colours.assign(element.count, {0, 0, 0, 1});
    for (size_t i = 0; i < element.count; ++i) {
      values_.begin(element, i);
      for (const Property& p : element.properties) {
        if (p.use == Use::kPosition) {
          mesh_.points[i][p.part] = values_.number(p.type);
        } else if (p.use == Use::kNormal && normals) {
          attributes.normals[i][p.part] = numbers_.clean(values_.number(p.type));
        } else if (p.use == Use::kTexture && texture) {
          attributes.texture_coordinates[i][static_cast<size_t>(p.part)] = numbers_.clean(values_.number(p.type));
        } else if (p.use == Use::kColour && colours) {
          attributes.vertex_colours[i][static_cast<size_t>(p.part)] =
              static_cast<float>(numbers_.clean(values_.number(p.type)) / kWholeColour[static_cast<size_t>(p.type)]);
        } else {
          skip(p);
        }
      }
      values_.end();
      bad_.check(mesh_.points[i], i, values_.line());
    }
    vertex_texture_ = texture, vertex_normals_ = normals;
  }

  void read_faces(const Element& element) {
    if (mesh_.topology.faces() > 0) throw Error(ErrorCode::kFile, in_file(name_), "has two face elements");
    if (!element.has(Use::kCorners, 1)) throw Error(ErrorCode::kFile, in_file(name_), "its faces have no list 'vertex_indices'");
    mesh_.topology.face_offsets.reserve(element.count + 1);
    mesh_.topology.face_vertices.reserve(3 * element.count);
    for (size_t i = 0; i < element.count; ++i) {
      values_.begin(element, i);
      for (const Property& p : element.properties) {
        if (p.use == Use::kCorners && mesh_.topology.faces() == i)
          read_corners(p, i);
        else if (p.use == Use::kCornerTexture && mesh_.topology.faces() == i + 1)
          read_corner_texture(p);
        else
          skip(p);
      }
      values_.end();
      if (!face_texture_.empty()) face_texture_.resize(mesh_.topology.corners(), -1);
    }
  }

  void read_corners(const Property& property, size_t face) {
    const size_t corners = list_length(property);
    if (corners < 3) values_.fail("face " + std::to_string(face) + " has " + counted(corners, "corner", "corners") + "; it needs at least three");
    for (size_t k = 0; k < corners; ++k) {
      const int64_t v = values_.integer(property.type);
      if (v < 0 || v > INT32_MAX) values_.fail("face " + std::to_string(face) + " refers to vertex " + std::to_string(v) + "; PLY counts from 0");
      largest_ = std::max(largest_, {v, face, values_.line()});
      mesh_.topology.face_vertices.push_back(static_cast<uint32_t>(v));
    }
    if (mesh_.topology.corners() > INT32_MAX) values_.fail("the mesh has more than 2,147,483,647 corners");
    mesh_.close_face();
  }

  // 2 numbers per corner; equal neighbours in the list of one face are not joined, seams stay as they are.
  void read_corner_texture(const Property& property) {
    corner_numbers_.clear();
    for (size_t n = list_length(property); n > 0; --n) corner_numbers_.push_back(numbers_.clean(values_.number(property.type)));
    const size_t first = mesh_.topology.face_offsets[mesh_.topology.faces() - 1];
    const size_t corners = mesh_.topology.corners() - first;
    if (corner_numbers_.size() != 2 * corners) return;
    face_texture_.resize(first, -1);
    for (size_t k = 0; k < corners; ++k) {
      face_texture_.push_back(static_cast<int32_t>(corner_pool_.size()));
      corner_pool_.push_back({corner_numbers_[2 * k], corner_numbers_[2 * k + 1]});
    }
  }

  void finish(std::vector<std::string>& warnings) {
    MeshTopology& topology = mesh_.topology;
    MeshAttributes& attributes = mesh_.attributes;
    if (topology.faces() > 0 && static_cast<size_t>(largest_.vertex) >= mesh_.points.size())
      throw Error(ErrorCode::kFile, in_file(name_, largest_.line),
                  "face " + std::to_string(largest_.face) + " refers to vertex " + std::to_string(largest_.vertex) + ", but the file has only " +
                      std::to_string(mesh_.points.size()) + " (counted from 0)",
                  "the file is damaged; export it again");
    const std::vector<int32_t> corners(topology.face_vertices.begin(), topology.face_vertices.end());
    if (vertex_normals_) attributes.corner_normal = corners;
    if (vertex_texture_) attributes.corner_texture = corners;
    if (!face_texture_.empty()) {
      attributes.texture_coordinates = std::move(corner_pool_);
      attributes.corner_texture = std::move(face_texture_);
    }
    numbers_.warn("normals, texture coordinates and colours", warnings);
  }

  struct Reference {
    int64_t vertex = 0;
    size_t face = 0;
    int line = 0;
    bool operator<(const Reference& other) const { return vertex < other.vertex; }
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
  bool vertex_texture_ = false, vertex_normals_ = false;
};

}  // namespace

RawMesh read_ply(std::string_view bytes, const std::string& name, std::vector<std::string>& warnings) {
  static_assert(std::endian::native == std::endian::little || std::endian::native == std::endian::big);
  TextReader text(bytes, name);
  const Header header = read_header(text);
  const std::string_view body = bytes.substr(std::min(bytes.size(), text.offset_after_line()));
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
