#include <algorithm>
#include <cmath>

#include "graph/registry.h"
#include "kernels/port_types.h"

namespace knead {

namespace {

const char* const kManual = R"(Paints a weight on every vertex of a surface: pins, holds, anything that takes Weights.

A vertex gets `inside` in the region, `outside` away from it, and in between, within `falloff` of the region's border, a smoothstep of the distance.
Regions:
  all      every vertex
  box      between the corners `lower` and `upper`
  sphere   within `radius` of `centre`
  plane    the half space behind the plane through `point` with normal `normal`: dot(x - point, normal) <= 0
  colour   `channel` of the file's vertex colours, 0 to 1, mixes outside to inside; no falloff
  group    the vertices of the faces in the file's group `group`; no falloff
`space` says where the numbers are: `world`, as the surface stands, or `local`, as its file has it, before any transform. A vertex within 1e-6 of the
surface's diagonal of the border counts as inside, so that rounding cannot unpin one. With `onto`, the result is combined with those weights by
`combine`.

  pins: {type: weights, surface: body, region: plane, normal: [0, 0, 1]}      # pins the vertices with z <= 0)";

class WeightsNode : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "world", .doc = "whose vertices to paint, at rest"}};
  OptionalIn<Weights> onto{this, "onto", {.shape = "vertices", .doc = "weights to combine with"}};
  Param<std::string> region{this, "region", "all", {.choices = {"all", "box", "sphere", "plane", "colour", "group"}, .doc = "which vertices"}};
  Param<std::string> space{this, "space", "world", {.choices = {"world", "local"}, .doc = "of the numbers below"}};
  Param<Triple> lower{this, "lower", {-1, -1, -1}, {.unit = "space", .doc = "corner of the box"}};
  Param<Triple> upper{this, "upper", {1, 1, 1}, {.unit = "space", .doc = "the other corner"}};
  Param<Triple> centre{this, "centre", {0, 0, 0}, {.unit = "space", .doc = "of the sphere"}};
  Param<double> radius{this, "radius", 1, {.min = 0, .unit = "space", .doc = "of the sphere"}};
  Param<Triple> point{this, "point", {0, 0, 0}, {.unit = "space", .doc = "on the plane"}};
  Param<Triple> normal{this, "normal", {0, 0, 1}, {.doc = "of the plane, away from the region; of any length"}};
  Param<std::string> channel{this, "channel", "red", {.choices = {"red", "green", "blue", "alpha"}, .doc = "of the vertex colours"}};
  Param<std::string> group{this, "group", "", {.doc = "name of a face group"}};
  Param<double> inside{this, "inside", 1, {.doc = "weight in the region"}};
  Param<double> outside{this, "outside", 0, {.doc = "weight away from it"}};
  Param<double> falloff{this, "falloff", 0, {.min = 0, .unit = "space", .doc = "width of the border outside the region"}};
  Param<std::string> combine{this, "combine", "multiply", {.choices = {"multiply", "add", "max", "min"}, .doc = "with `onto`"}};
  Out<Weights> weights{this, "weights", {.shape = "vertices", .doc = "one a vertex"}};

  void configure() override {
    if (region() == "plane" && length(vector(normal())) == 0) throw Error(ErrorCode::kGraph, "the plane's normal has no length", "[0, 0, 1] is z");
    if (region() == "group" && group().empty()) throw Error(ErrorCode::kGraph, "which group?", "give its name as group");
    for (int k = 0; k < 3 && region() == "box"; ++k)
      if (lower()[k] > upper()[k]) throw Error(ErrorCode::kGraph, "the box's lower corner is above its upper", "exchange them");
  }

  void evaluate(Context& context) const override {
    const Surface& mesh = context.get(surface);
    const Weights* under = context.get(onto);
    if (under && under->values.size() != mesh.vertices())
      throw Error(ErrorCode::kInput,
                  "onto has " + std::to_string(under->values.size()) + " weights for " + std::to_string(mesh.vertices()) + " vertices",
                  "paint both on the same surface");
    Weights painted{Buffer<float>(mesh.vertices())};
    float* out = painted.values.data_for_write();
    if (region() == "colour")
      from_colours(mesh, out);
    else if (region() == "group")
      from_group(mesh, out);
    else
      from_distance(mesh, out);
    for (size_t i = 0; under && i < mesh.vertices(); ++i) {
      const float a = under->values.host()[i];
      if (combine() == "multiply")
        out[i] *= a;
      else if (combine() == "add")
        out[i] += a;
      else
        out[i] = combine() == "max" ? std::max(a, out[i]) : std::min(a, out[i]);
    }
    context.set(weights, std::move(painted));
  }

 private:
  static Vec3d vector(const Triple& t) { return {t[0], t[1], t[2]}; }
  float mixed(double share) const { return static_cast<float>(outside() + (inside() - outside()) * share); }

  double distance(const Vec3d& p) const {  // to the region, negative or zero inside
    if (region() == "all") return 0;
    if (region() == "sphere") return length(p - vector(centre())) - radius();
    if (region() == "plane") return dot(p - vector(point()), vector(normal())) / length(vector(normal()));
    Vec3d beyond;
    for (int k = 0; k < 3; ++k) beyond[k] = std::max({lower()[k] - p[k], p[k] - upper()[k], 0.0});
    return length(beyond);
  }

  void from_distance(const Surface& mesh, float* out) const {
    const Similarity placement = space() == "world" ? mesh.placement : Similarity{};
    const double tolerance = 1e-6 * mesh.diagonal() * placement.scale;
    const auto points = mesh.points.host();
    for (size_t i = 0; i < points.size(); ++i) {
      const double d = distance(placement.apply(to_double(points[i]))) - tolerance;
      const double t = d <= 0 ? 1 : d < falloff() ? 1 - d / falloff() : 0;
      out[i] = mixed(t * t * (3 - 2 * t));
    }
  }

  void from_colours(const Surface& mesh, float* out) const {
    if (!mesh.attributes || mesh.attributes->vertex_colours.size() != mesh.vertices())
      throw Error(ErrorCode::kInput, "the surface has no vertex colours", "PLY files, and OBJ files with six numbers a vertex, can carry them");
    const size_t c = channel() == "red" ? 0 : channel() == "green" ? 1 : channel() == "blue" ? 2 : 3;
    for (size_t i = 0; i < mesh.vertices(); ++i) out[i] = mixed(mesh.attributes->vertex_colours[i][c]);
  }

  void from_group(const Surface& mesh, float* out) const {
    const std::vector<std::string> names = mesh.attributes ? mesh.attributes->groups : std::vector<std::string>{};
    const auto found = std::find(names.begin(), names.end(), group());
    if (found == names.end()) {
      const std::string near = nearest_name(group(), names);
      std::string all;
      for (size_t i = 0; i < names.size() && i < 10; ++i) all += (i ? ", " : "it has ") + names[i];
      throw Error(ErrorCode::kInput, "the surface has no group '" + group() + "'",
                  !near.empty()   ? "did you mean '" + near + "'?"
                  : names.empty() ? "it has no groups at all"
                                  : all);
    }
    const int32_t wanted = static_cast<int32_t>(found - names.begin());
    std::fill(out, out + mesh.vertices(), mixed(0));
    const MeshTopology& topology = *mesh.topology;
    for (size_t f = 0; f < topology.faces() && f < mesh.attributes->face_group.size(); ++f)
      if (mesh.attributes->face_group[f] == wanted)
        for (uint32_t c = topology.face_offsets[f]; c < topology.face_offsets[f + 1]; ++c) out[topology.face_vertices[c]] = mixed(1);
  }
};

}  // namespace

KNEAD_REGISTER(weights, WeightsNode, 1, kManual)

}  // namespace knead
