#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "graph/registry.h"
#include "kernels/motion.h"

namespace knead {

namespace {

const char* const kManual = R"(Moves, turns and scales a mesh, once or over frames.

  x_out = translate + pivot + R (scale * (x - pivot))

in world units. `rotate` is [rx, ry, rz] in degrees, about the world's x first, then y, then z; or {axis: [x, y, z], degrees: a}. `scale` is a number
or [x, y, z], all positive. Rigid motion and uniform scale change the mesh's placement alone: its points stay the same buffer, so what is built from
them (an SDF, tets) is built once for all frames. Scale that differs by axis makes new points.

`keys` maps frames to {translate, rotate, scale, pivot}; what a key leaves out it takes from the parameters of the same name. Before the first key and
after the last, that key holds. Between keys, `interpolation`:
  linear   straight lines; rotations by quaternion slerp, at constant speed
  smooth   monotone cubics (Fritsch and Carlson 1980) that start and stop gently and never go beyond the keys on either side;
           rotations follow the same slerps at a continuous speed
A slerp goes the shorter way: to turn further than 180 degrees, put a key in between.

  motion: {type: transform, mesh: fist, interpolation: smooth, keys: {1: {translate: [0, 0, 2]}, 24: {translate: [0, 0, 0.6], rotate: [0, 0, 30]}}})";

// Reads a pose's fields from literals, naming the place in every error.
class PoseReader {
 public:
  PoseReader(const char* member, std::string what) : member_(member), what_(std::move(what)) {}

  [[noreturn]] void fail(const Literal& at, const std::string& message, std::string hint = {}) const {
    Where where;
    where.line = at.line;
    where.column = at.column;
    where.member = member_;
    throw Error(ErrorCode::kGraph, where, what_ + message, std::move(hint));
  }
  void fields(const Literal& at, const std::vector<std::string>& known) const {
    for (const auto& [name, value] : *at.as_map()) {
      const std::string* text = name.as_string();
      if (text && std::find(known.begin(), known.end(), *text) != known.end()) continue;
      const std::string near = text ? nearest_name(*text, known) : "";
      std::string all;
      for (const std::string& k : known) all += (all.empty() ? "" : ", ") + k;
      fail(name, "unknown field " + name.text(), near.empty() ? "it takes " + all : "did you mean '" + near + "'?");
    }
  }
  Vec3d triple(const Literal& literal, const char* field) const {
    Triple t{};
    if (std::string wrong = ParamTraits<Triple>::parse(literal, t); !wrong.empty()) fail(literal, std::string(field) + ": " + wrong);
    return {t[0], t[1], t[2]};
  }
  Quaternion rotation(const Literal& literal) const {
    if (!literal.as_map()) return rotation_xyz(triple(literal, "rotate"));
    fields(literal, {"axis", "degrees"});
    const Literal *axis = literal.find("axis"), *degrees = literal.find("degrees");
    if (!axis || !degrees || !degrees->is_number() || !std::isfinite(degrees->number()))
      fail(literal, "rotate needs an axis and degrees", "{axis: [0, 1, 0], degrees: 90}, or [rx, ry, rz]");
    const Vec3d a = triple(*axis, "rotate: axis");
    if (length(a) == 0) fail(*axis, "rotate: the axis has no length", "[0, 1, 0] is y");
    return rotation_about(a, degrees->number());
  }
  Vec3d scale(const Literal& literal) const {
    double all = 0;
    Vec3d s;
    if (literal.is_number()) {
      if (std::string wrong = ParamTraits<double>::parse(literal, all); !wrong.empty()) fail(literal, "scale: " + wrong);
      s = {all, all, all};
    } else {
      s = triple(literal, "scale");
    }
    if (!(s.x > 0 && s.y > 0 && s.z > 0)) fail(literal, "scale must be positive", "a mirrored mesh would be inside out");
    return s;
  }

 private:
  const char* member_;
  std::string what_;
};

double frame_of(const Literal& name, const PoseReader& reader) {
  if (name.is_number() && std::isfinite(name.number())) return name.number();
  if (const std::string* text = name.as_string()) {  // JSON has no other keys
    double frame = 0;
    const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), frame);
    if (error == std::errc() && end == text->data() + text->size() && std::isfinite(frame)) return frame;
  }
  reader.fail(name, name.text() + " is not a frame", "keys are frame numbers");
}

class Transform : public Node {
 public:
  In<Surface> mesh{this, "mesh", {.unit = "world", .doc = "what to move"}};
  Param<Triple> translate{this, "translate", {0, 0, 0}, {.unit = "world", .doc = "where to"}};
  Param<Literal> rotate{this, "rotate", Literal::List{0, 0, 0}, {.unit = "degrees", .doc = "[rx, ry, rz], x first, or {axis, degrees}"}};
  Param<Literal> scale{this, "scale", 1, {.doc = "a number, or one for each axis; positive"}};
  Param<Triple> pivot{this, "pivot", {0, 0, 0}, {.unit = "world", .doc = "the point that rotation and scale leave where it is"}};
  Param<Literal> keys{this, "keys", Literal::Map{}, {.doc = "frame: {translate, rotate, scale, pivot}"}};
  Param<std::string> interpolation{this, "interpolation", "linear", {.choices = {"linear", "smooth"}, .doc = "between keys"}};
  Out<Surface> surface{this, "surface", {.unit = "world", .doc = "the mesh, moved"}};

  void configure() override {
    const PoseReader turning("rotate", ""), sizing("scale", ""), keyed("keys", "");
    Pose still;
    still.translate = {translate()[0], translate()[1], translate()[2]};
    still.rotate = turning.rotation(rotate());
    still.scale = sizing.scale(scale());
    still.pivot = {pivot()[0], pivot()[1], pivot()[2]};
    const Literal::Map* map = keys().as_map();
    if (!map && !keys().is_null())
      keyed.fail(keys(), std::string("expected a map of frames, found ") + keys().kind(), "keys: {1: {translate: [0, 0, 1]}}");
    poses_.clear();
    for (const auto& [name, value] : map ? *map : Literal::Map{}) {
      const double frame = frame_of(name, keyed);
      const PoseReader reader("keys", "key " + name.text() + ": ");
      if (!value.as_map()) reader.fail(value, std::string("expected a map, found ") + value.kind(), "{translate: [x, y, z], ...}");
      reader.fields(value, {"translate", "rotate", "scale", "pivot"});
      Pose pose = still;
      if (const Literal* l = value.find("translate")) pose.translate = reader.triple(*l, "translate");
      if (const Literal* l = value.find("rotate")) pose.rotate = reader.rotation(*l);
      if (const Literal* l = value.find("scale")) pose.scale = reader.scale(*l);
      if (const Literal* l = value.find("pivot")) pose.pivot = reader.triple(*l, "pivot");
      for (const PoseKey& other : poses_)
        if (other.frame == frame) reader.fail(name, "the frame has a key already", "one key a frame");
      poses_.push_back({frame, pose});
    }
    if (poses_.empty()) poses_.push_back({0, still});
    std::sort(poses_.begin(), poses_.end(), [](const PoseKey& a, const PoseKey& b) { return a.frame < b.frame; });
  }

  bool depends_on_frame() const override { return poses_.size() > 1; }

  void evaluate(Context& context) const override {
    const double frame = depends_on_frame() ? context.frame() : 0;
    context.set(surface,
                posed(context.get(mesh), pose_at(poses_, frame, interpolation() == "smooth" ? Interpolation::kSmooth : Interpolation::kLinear)));
  }

 private:
  std::vector<PoseKey> poses_ = {PoseKey{}};  // by frame; never empty
};

}  // namespace

KNEAD_REGISTER(transform, Transform, 1, kManual)

}  // namespace knead
