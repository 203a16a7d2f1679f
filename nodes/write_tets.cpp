// write_tets: H to a file.
#include "graph/registry.h"
#include "io/files.h"
#include "io/tets/tet_file.h"
#include "kernels/loop/hold.h"
#include "kernels/port_types.h"

namespace knead {

namespace {

const char* const kManual = R"(Writes the helper tet mesh H to .vtu (VTK, for ParaView), .vtk (VTK's older format) or .msh (Gmsh 4.1).

Vertices are where `points` has them, or at rest without it. With `lattice` they stand in the world; without it in M's own space. Fields by vertex: `rest`, the
rest position in the same space (with `points`), and `weight`, painted weights of M brought to H as the solver has them (with `weights`, which need the
lattice; where no vertex of M is near, their mean). Fields by tet: `rest_volume`, and `volume_ratio`, the volume now over that at rest (with `points`):
negative where a tet is inverted.

A run of '#' in the file's name is the frame: out/h.####.vtu at frame 7 is out/h.0007.vtu. The file appears whole or not at all. What is written at rest,
read_tets reads.)";

class WriteTets : public Node {
 public:
  In<TetMesh> tets{this, "tets", {.unit = "cells", .doc = "H at rest"}};
  OptionalIn<Points> points{this, "points", {.unit = "cells", .shape = "vertices of H", .doc = "H now, in tet space"}};
  OptionalIn<Lattice> lattice{this, "lattice", {.doc = "M in H, for H's place in the world"}};
  OptionalIn<Weights> weights{this, "weights", {.shape = "vertices of M", .doc = "painted weights of M, such as stiffness"}};
  Param<std::string> path{this, "path", "", {.doc = "the file, .vtu, .vtk or .msh; '#'s in its name stand for the frame"}};

  void configure() override {
    if (path().empty()) throw Error(ErrorCode::kGraph, Where{{}, 0, 0, {}, "path"}, "no file is named", "set path to a .vtu, .vtk or .msh file");
    check_writable_tet_name(path());
  }
  bool depends_on_frame() const override { return has_frame_pattern(path()); }
  bool has_effect() const override { return true; }

  void evaluate(Context& context) const override {
    const std::string file = path_in_frame(path(), context);
    context.check_cancelled();
    const TetMesh& h = context.get(tets);
    const Lattice* bound = context.get(lattice);
    const Points* now = context.get(points);
    const Weights* paint = context.get(weights);
    if (now && now->values.size() != h.vertices())
      throw Error(ErrorCode::kInput,
                  "points has " + std::to_string(now->values.size()) + " positions and tets " + std::to_string(h.vertices()) + " vertices");
    if (paint && !bound) throw Error(ErrorCode::kInput, "weights are painted on M: without a lattice they cannot be brought to H", "connect lattice");
    const Similarity place = bound ? bound->rest.placement * h.to_local : h.to_local;
    const auto rest = h.rest.host();
    const auto moved = now ? now->values.host() : rest;
    TetFile mesh;
    mesh.points = placed(moved, place);
    mesh.tets.assign(h.tets.host().begin(), h.tets.host().end());
    std::vector<TetField> fields;
    if (now) {
      TetField at_rest{"rest", false, 3, {}};
      for (const Vec3d& p : placed(rest, place)) at_rest.values.insert(at_rest.values.end(), {p.x, p.y, p.z});
      fields.push_back(std::move(at_rest));
    }
    if (paint) fields.push_back(weight_field(context.executor(), *paint, *bound));
    add_volumes(h, now ? &moved : nullptr, place.scale, fields);
    write_tet_file(file, mesh, fields);
  }

 private:
  static std::vector<Vec3d> placed(std::span<const Vec3f> points, const Similarity& place) {
    std::vector<Vec3d> placed;
    for (const Vec3f& p : points) placed.push_back(place.apply(to_double(p)));
    return placed;
  }
  static TetField weight_field(Executor& executor, const Weights& paint, const Lattice& bound) {
    double sum = 0;
    for (const float w : paint.values.host()) sum += static_cast<double>(w);
    const double mean = sum / static_cast<double>(std::max<size_t>(1, paint.values.size()));
    const Buffer<float> on_tets = paint_to_tets(executor, paint.values, bound, false, static_cast<float>(mean));
    return {"weight", false, 1, {on_tets.host().begin(), on_tets.host().end()}};
  }
  static void add_volumes(const TetMesh& h, const std::span<const Vec3f>* now, double scale, std::vector<TetField>& fields) {
    TetField volume{"rest_volume", true, 1, {}}, ratio{"volume_ratio", true, 1, {}};
    for (size_t t = 0; t < h.tets.size(); ++t) {
      const double rest = static_cast<double>(h.rest_volumes.host()[t]);
      volume.values.push_back(rest * scale * scale * scale);
      if (!now) continue;
      const auto& [a, b, c, d] = h.tets.host()[t];
      const auto from = [&](uint32_t v) { return to_double((*now)[v]) - to_double((*now)[a]); };
      ratio.values.push_back(dot(cross(from(b), from(c)), from(d)) / (6 * rest));
    }
    fields.push_back(std::move(volume));
    if (now) fields.push_back(std::move(ratio));
  }
};

}  // namespace

KNEAD_REGISTER(write_tets, WriteTets, 1, kManual)

}  // namespace knead
