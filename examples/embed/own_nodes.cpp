#include "own_nodes.h"

#include <cmath>
#include <memory>
#include <span>
#include <utility>

namespace {

// A node without inputs. Its key holds the mesh's contents, so that an evaluator, or a cache that several share, sees when the mesh is another one.
class HostMesh : public knead::Node {
 public:
  explicit HostMesh(knead::Surface mesh) : mesh_(std::move(mesh)) {
    const auto points = mesh_.points.host();
    knead::Hasher contents;
    contents.bytes(points.data(), points.size_bytes());
    for (const uint32_t corner : mesh_.topology->face_vertices) contents.add(corner);
    contents_ = contents.key();
  }
  knead::Out<knead::Surface> surface{this, "surface", {.unit = "world", .doc = "the mesh in memory"}};

  void add_to_key(knead::Hasher& hasher, int) const override { hasher.add(contents_); }
  void evaluate(knead::Context& context) const override { context.set(surface, mesh_); }

 private:
  knead::Surface mesh_;
  knead::Key contents_;
};

// Ports and parameters are typed members; checks, the manual and the cache's keys come from them.
class Ripple : public knead::Node {
 public:
  knead::In<knead::Surface> surface{this, "surface", {.unit = "world", .doc = "what the waves run over"}};
  knead::Param<double> height{this, "height", 0.01, {.min = 0, .unit = "world", .doc = "of the waves"}};
  knead::Param<double> length{this, "length", 0.3, {.min = 1e-6, .unit = "world", .doc = "from crest to crest, along x"}};
  knead::Out<knead::Surface> result{this, "surface", {.unit = "world", .doc = "with waves"}};

  bool depends_on_frame() const override { return true; }

  void evaluate(knead::Context& context) const override {
    knead::Surface out = context.get(surface);  // shares everything with the input; points are made anew
    const std::span<const knead::Vec3f> from = out.points.host();
    knead::Buffer<knead::Vec3f> points(from.size());
    knead::Vec3f* to = points.data_for_write();
    const double scale = out.placement.scale, turns = 2 * M_PI / length();
    for (size_t i = 0; i < from.size(); ++i) {
      if (i % 4096 == 0) context.check_cancelled();
      const double wave = height() * std::sin(turns * scale * from[i].x + 0.2 * context.frame());
      to[i] = {from[i].x, from[i].y + static_cast<float>(wave / scale), from[i].z};
    }
    out.points = std::move(points);
    context.set(result, std::move(out));
  }
};

}  // namespace

void add_own_nodes(knead::Registry& registry, knead::Surface mesh) {
  registry.add({"host_mesh", 1, "A mesh from the memory of this program.", [mesh] { return std::make_unique<HostMesh>(mesh); }, {}});
  registry.add({"ripple",
                1,
                "Waves along y that run over a surface: y + height sin(2 pi x / length + frame / 5).",
                [] { return std::make_unique<Ripple>(); },
                {}});
}
