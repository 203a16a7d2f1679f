#include "kernels/loop/collide.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "graph/error.h"
#include "kernels/device_tables.h"
#include "kernels/loop/collide_launch.h"
#include "kernels/parallel.h"
#include "kernels/surface/exact_distance.h"

namespace knead {
namespace {

constexpr float kBoxMargin = 3;         // voxels around the band: what central differences and rounding reach
constexpr double kSampledWithin = 0.5;  // voxels: the points of one face that are this near to the deepest in the grid are looked at exactly
constexpr double kSameWay = 0.5;        // cosine between two ways out of a collider that are taken as one
constexpr double kExactWithin = 1.8;    // voxels: within this of the surface a grid's value may be off by what its mesh decides

Similarity to_collider(const Sdf& sdf, const Similarity& body) {
  return sdf.placement.inverse() * body;
}

}  // namespace

ColliderView view_collider(const Sdf& sdf, Device device, const Similarity& body) {
  ColliderView view{};
  view.sdf.grid = reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.view(device).data());
  const Similarity local = to_collider(sdf, body);
  const double to_voxels = 1 / static_cast<double>(sdf.voxel_size);
  const Vec3d origin = to_double(sdf.index_origin), offset = (local.translation - origin) * to_voxels;
  for (int k = 0; k < 9; ++k) view.matrix[k] = static_cast<float>(local.rotation[k] * local.scale * to_voxels);
  view.offset = to_float(offset);
  view.scale = static_cast<float>(1 / local.scale);
  view.centre = to_float(local.inverse().apply((to_double(sdf.lower) + to_double(sdf.upper)) * 0.5));
  const float reach = sdf.outside_band / sdf.voxel_size + kBoxMargin;
  const auto index = [&](const Vec3f& local) { return to_float((to_double(local) - origin) * to_voxels); };
  const Vec3f lower = index(sdf.lower), upper = index(sdf.upper), known_lower = index(sdf.known_lower), known_upper = index(sdf.known_upper);
  view.sdf.voxel = sdf.voxel_size;
  view.sdf.lower = lower - Vec3f{reach, reach, reach};
  view.sdf.upper = upper + Vec3f{reach, reach, reach};
  for (int k = 0; k < 3; ++k) {
    view.sdf.lower[k] = std::max(view.sdf.lower[k], known_lower[k]);
    view.sdf.upper[k] = std::min(view.sdf.upper[k], known_upper[k]);
  }
  return view;
}

void check_margin(const Sdf& sdf, const Similarity& body, double margin, size_t which) {
  const double band = sdf.outside_band * sdf.placement.scale, asked = margin * body.scale;
  if (margin == 0 || (asked < band && margin > 0)) return;
  throw Error(
      ErrorCode::kInput,
      "margin " + std::to_string(asked) + " is not within the outside band of collider " + std::to_string(which + 1) + ", " + std::to_string(band),
      margin < 0 ? "a margin is zero or positive" : "raise mesh_to_sdf's band, or lower the margin");
}

namespace {

// Of what a sampler does not answer with the background at once, in M's local space. Its margin is voxels wide, roundings are not.
void find_box(const Sdf& sdf, const Similarity& body, const SdfView& view, Vec3f& lower, Vec3f& upper) {
  const Similarity from_collider = to_collider(sdf, body).inverse();
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3f index{corner & 1 ? view.upper.x : view.lower.x, corner & 2 ? view.upper.y : view.lower.y, corner & 4 ? view.upper.z : view.lower.z};
    const Vec3f at = to_float(from_collider.apply(to_double(sdf.index_origin) + static_cast<double>(sdf.voxel_size) * to_double(index)));
    if (corner == 0) lower = upper = at;
    lower = {std::min(lower.x, at.x), std::min(lower.y, at.y), std::min(lower.z, at.z)};
    upper = {std::max(upper.x, at.x), std::max(upper.y, at.y), std::max(upper.z, at.z)};
  }
}

}  // namespace

namespace {

PushCollider push_collider(Executor& executor, const CollideInput& input, size_t k) {
  check_margin(*input.colliders[k], input.placement, input.margin, k);
  PushCollider collider{view_collider(*input.colliders[k], executor.device(), input.placement), {}, {}, static_cast<uint32_t>(k)};
  find_box(*input.colliders[k], input.placement, collider.view.sdf, collider.lower, collider.upper);
  return collider;
}

struct Box {
  Vec3f lower, upper;
  bool clear_of(const PushCollider& c) const {
    return upper.x < c.lower.x || upper.y < c.lower.y || upper.z < c.lower.z || lower.x > c.upper.x || lower.y > c.upper.y || lower.z > c.upper.z;
  }
};

// NaNs are passed over; with nothing else the box is clear of everything.
Box box_of(std::span<const Vec3f> points) {
  constexpr float kMost = std::numeric_limits<float>::max();
  Box box{{kMost, kMost, kMost}, {-kMost, -kMost, -kMost}};
  for (const Vec3f& p : points)
    for (int k = 0; k < 3; ++k) box.lower[k] = std::min(box.lower[k], p[k]), box.upper[k] = std::max(box.upper[k], p[k]);
  return box;
}

}  // namespace

Buffer<std::byte> prepare_colliders(Executor& executor, const CollideInput& input) {
  if (executor.device() == Device{} || input.colliders.size() <= CollidePush::kFew) return {};
  std::vector<PushCollider> all;
  for (size_t k = 0; k < input.colliders.size(); ++k) all.push_back(push_collider(executor, input, k));
  const Buffer<PushCollider> there = device_copy(executor, std::span<const PushCollider>(all));
  executor.synchronise();
  return there.as<std::byte>();
}

CollidePush make_push(Executor& executor, const CollideInput& input, ManyColliders& many) {
  CollidePush body{};
  body.points = input.points.data();
  body.memory = input.memory.empty() ? nullptr : input.memory.data();
  body.margin = static_cast<float>(input.margin);
  body.rate = static_cast<float>(input.rate);
  body.most = static_cast<float>(input.most);
  body.diagonal = input.diagonal;
  body.before = input.before;
  body.stand_back = input.stand_back.empty() ? nullptr : input.stand_back.data();
  body.left_out = std::numeric_limits<float>::max();
  const size_t all = input.colliders.size();
  if (executor.device() != Device{} && all > CollidePush::kFew) {
    many.there = input.prepared.empty() ? prepare_colliders(executor, input) : input.prepared;
    body.many = many.there.as<PushCollider>().view(executor.device()).data();
    body.count = static_cast<uint32_t>(all);
    return body;
  }
  const bool in_place = input.stand_back.empty() && executor.device() == Device{};
  const Box box = in_place && all > 1 ? box_of(input.points) : Box{};
  for (size_t k = 0; k < all; ++k) {
    const PushCollider one = push_collider(executor, input, k);
    if (in_place && all > 1 && box.clear_of(one)) {
      body.left_out = std::min(body.left_out, SdfSampler(one.view.sdf).background() * one.view.scale - body.margin);
      continue;
    }
    if (body.count == CollidePush::kFew) many.here.assign(body.few, body.few + CollidePush::kFew);
    if (body.count < CollidePush::kFew)
      body.few[body.count] = one;
    else
      many.here.push_back(one);
    ++body.count;
  }
  body.many = many.here.empty() ? nullptr : many.here.data();
  return body;
}

void collide_push(Executor& executor, const CollideInput& input, Vec3f* displacement, float* memory_out, ContactProgress* after) {
  ManyColliders many;
  CollidePush body = make_push(executor, input, many);
  body.displacement = displacement;
  body.memory_out = memory_out;
  body.after = after;
  reduce(executor, input.points.size(), body);
}

void add_displacement(Executor& executor, std::span<const Vec3f> points, const Vec3f* displacement, Vec3f* moved) {
  parallel_for(executor, points.size(), AddDisplacement{points.data(), displacement, moved});
}

namespace {

struct Contact {
  double depth = 0;    // below the margin, M's local units; positive: in collision
  Vec3d out{0, 0, 0};  // unit, M's local space
  size_t collider = 0;
};

class Projector {
 public:
  Projector(const ProjectInput& input) : input_(input) {
    for (size_t k = 0; k < input.colliders.size(); ++k) {
      check_margin(*input.colliders[k], input.placement, input.margin, k);
      views_.push_back(view_collider(*input.colliders[k], Device{}, input.placement));
      local_.push_back(to_collider(*input.colliders[k], input.placement));
      find_box(*input.colliders[k], input.placement, views_[k].sdf, lower_.emplace_back(), upper_.emplace_back());
    }
  }

  // How deep y is in the collider that it is deepest in.
  Contact contact(const Vec3d& y) const {
    Contact deepest;
    for (size_t k = 0; k < views_.size(); ++k) {
      Contact one = contact(y, k);
      one.collider = k;
      if (one.depth > deepest.depth) deepest = one;
    }
    return deepest;
  }

  // The same in the fields' interpolants alone, which are off by part of a voxel; and the most that the part may be.
  double sampled_depth(const Vec3d& y) const {
    double deepest = -std::numeric_limits<double>::infinity();
    for (size_t k = 0; k < views_.size(); ++k)
      deepest =
          std::max(deepest, input_.margin - (only_exact(k) ? exact_distance(y, k).distance / local_[k].scale : static_cast<double>(sampled(y, k))));
    return deepest;
  }
  // Whether nothing within `radius` of y can be in collision.
  bool free_within(const Vec3d& y, double radius) const {
    for (size_t k = 0; k < views_.size(); ++k) {
      const ColliderView& view = views_[k];
      const double least = only_exact(k) ? exact_distance(y, k).distance / local_[k].scale
                                         : static_cast<double>(SdfSampler(view.sdf).least(view.to_index(to_float(y))) * view.scale);
      if (!(least > input_.margin + radius)) return false;
    }
    return true;
  }
  double sampling_error() const {
    double most = 0;
    for (size_t k = 0; k < views_.size(); ++k)
      most = std::max(most, kSampledWithin * static_cast<double>(input_.colliders[k]->voxel_size * views_[k].scale));
    return most;
  }

  // The way out for a vertex of a face that is in contact: the smooth field's at the vertex, which turns slowly as the collider moves, where that leads out of
  // the contact too.
  Vec3d way_out(const Vec3f& vertex, const Contact& of_face) const {
    const Vec3d own = to_double(CollidePush::outwards(views_[of_face.collider], vertex, false));
    return dot(own, of_face.out) > kSameWay ? own : of_face.out;
  }

  // Moves p until it is outside, in float steps, and keeps the best place met. Returns how deep it still is.
  double move_out(Vec3f& p) const {
    Vec3f best = p;
    double least = std::numeric_limits<double>::infinity();
    for (int round = 0; round < input_.rounds; ++round) {
      const Contact now = contact(to_double(p));
      if (now.depth < least) least = now.depth, best = p;
      if (now.depth <= 0) break;
      const Vec3f next = to_float(to_double(p) + now.out * (now.depth + input_.clearance));
      if (next.x == p.x && next.y == p.y && next.z == p.z) break;
      p = next;
    }
    p = best;
    return least;
  }

 private:
  // The field is that of a part of the collider, such as a plane's, and the collider is known beside it.
  bool only_exact(size_t k) const { return !input_.meshes.empty() && input_.meshes[k] && input_.colliders[k]->known_upper.x < Sdf::kEverywhere; }
  SignedDistance exact_distance(const Vec3d& y, size_t k) const { return input_.meshes[k]->signed_distance(local_[k].apply(y)); }
  float sampled(const Vec3d& y, size_t k) const { return SdfSampler(views_[k].sdf).value(views_[k].to_index(to_float(y))) * views_[k].scale; }

  Contact contact(const Vec3d& y, size_t k) const {
    const ColliderView& view = views_[k];
    const Sdf& sdf = *input_.colliders[k];
    const bool exact_only = only_exact(k);
    if (!exact_only && CollidePush::outside(to_float(y), lower_[k], upper_[k])) return {};  // as far away as the band, which the margin is within
    SdfSampler sampler(view.sdf);
    const Vec3f index = view.to_index(to_float(y));
    const double value = sampler.value(index) * view.scale;  // M's local units
    const ExactDistance* mesh = input_.meshes.empty() ? nullptr : input_.meshes[k];
    if (mesh) {
      if (!exact_only && value > input_.margin + kExactWithin * sdf.voxel_size * view.scale) return {};
      const SignedDistance exact = exact_distance(y, k);
      Vec3d out = exact.normal;
      // Back into M's space by the transposed rotation.
      const auto& r = local_[k].rotation;
      out = {r[0] * out.x + r[3] * out.y + r[6] * out.z, r[1] * out.x + r[4] * out.y + r[7] * out.z, r[2] * out.x + r[5] * out.y + r[8] * out.z};
      return {input_.margin - exact.distance / local_[k].scale, out};
    }
    if (value >= input_.margin) return {};
    Vec3f slope;
    sampler.value_and_gradient(index, slope);
    const Vec3d g = to_double(view.from_index(slope)) * static_cast<double>(view.scale);
    const double size = length(g);
    if (size < kLeastSlope) return {input_.margin - value, to_double(CollidePush::outwards(view, to_float(y), true))};
    return {(input_.margin - value) / std::min(1.0, size), g * (1 / size)};
  }

  const ProjectInput& input_;
  std::vector<ColliderView> views_;
  std::vector<Similarity> local_;
  std::vector<Vec3f> lower_, upper_;  // boxes around the colliders, M's local space
};

constexpr int kMostSampleSteps = 32;
constexpr size_t kMostSamples = (kMostSampleSteps + 1) * (kMostSampleSteps + 2) / 2;

// Points of a triangle's barycentric grid other than its corners; weights of the first two corners. At most kMostSampleSteps steps.
std::vector<std::array<double, 2>> sample_weights(int n) {
  n = std::min(n, kMostSampleSteps);
  std::vector<std::array<double, 2>> weights;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; i + j <= n; ++j)
      if (i != n && j != n && i + j != 0) weights.push_back({static_cast<double>(i) / n, static_cast<double>(j) / n});
  return weights;
}

// Of the points of a triangle.
Contact deepest_of(const Projector& projector, const std::vector<std::array<double, 2>>& weights, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d middle = (1.0 / 3) * (a + b + c);
  if (projector.free_within(middle, 1.01 * std::max({length(a - middle), length(b - middle), length(c - middle)}))) return {};
  std::array<double, kMostSamples> sampled;
  const auto point = [&](size_t i) { return c + (a - c) * weights[i][0] + (b - c) * weights[i][1]; };
  for (size_t i = 0; i < weights.size(); ++i) sampled[i] = projector.sampled_depth(point(i));
  const double least = *std::max_element(sampled.begin(), sampled.begin() + static_cast<ptrdiff_t>(weights.size())) - projector.sampling_error();
  Contact deepest;
  for (size_t i = 0; i < weights.size(); ++i) {
    if (sampled[i] < least) continue;
    const Contact at = projector.contact(point(i));
    if (at.depth > deepest.depth) deepest = at;
  }
  return deepest;
}

// Pushes triangles whose samples are inside: each vertex takes the deepest push among its triangles, then goes back outside itself. Gathered, so that
// the order of triangles does not matter.
double push_samples(Executor& executor, const ProjectInput& input, const Projector& projector, Vec3f* moved) {
  const size_t n = input.points.size(), count = input.triangles.size() / 3;
  const std::vector<std::array<double, 2>> weights = sample_weights(input.samples);
  std::vector<uint32_t> first(n + 1, 0), incident(3 * count);
  for (uint32_t v : input.triangles) ++first[v + 1];
  for (size_t v = 0; v < n; ++v) first[v + 1] += first[v];
  std::vector<uint32_t> cursor(first.begin(), first.end() - 1);
  for (size_t c = 0; c < 3 * count; ++c) incident[cursor[input.triangles[c]]++] = static_cast<uint32_t>(c / 3);

  std::vector<Contact> worst(count);
  std::vector<uint8_t> pushed(n, 1);  // since its triangles were looked at
  double deepest = 0, least = std::numeric_limits<double>::infinity();
  int idle = 0;  // rounds without progress: a triangle that spans a collider cannot be pushed out
  for (int round = 0; round <= input.rounds; ++round) {
    deepest = reduce_max(executor, count, "project_samples", [&](uint32_t t) {
      const uint32_t* corner = &input.triangles[3 * size_t{t}];
      if (!pushed[corner[0]] && !pushed[corner[1]] && !pushed[corner[2]]) return worst[t].depth;
      const Vec3d a = to_double(moved[corner[0]]), b = to_double(moved[corner[1]]), c = to_double(moved[corner[2]]);
      worst[t] = deepest_of(projector, weights, a, b, c);
      return worst[t].depth;
    });
    idle = deepest < 0.95 * least ? 0 : idle + 1;
    least = std::min(least, deepest);
    if (deepest <= input.clearance || round == input.rounds || idle > 5) break;
    parallel_for(executor, n, "project_faces", [&](uint32_t v) {
      Contact push;
      for (uint32_t k = first[v]; k < first[v + 1]; ++k)
        if (worst[incident[k]].depth > push.depth) push = worst[incident[k]];
      pushed[v] = push.depth > 0;
      if (!pushed[v]) return;
      moved[v] = to_float(to_double(moved[v]) + projector.way_out(moved[v], push) * (push.depth + input.clearance));
      projector.move_out(moved[v]);
    });
  }
  return deepest;
}

}  // namespace

ProjectFigures project_outside(Executor& executor, const ProjectInput& input, Vec3f* moved) {
  const Projector projector(input);
  struct Sum {
    double before = 0, left = 0;
    size_t inside = 0, still = 0;
  };
  auto combine = [](const Sum& a, const Sum& b) {
    return Sum{std::max(a.before, b.before), std::max(a.left, b.left), a.inside + b.inside, a.still + b.still};
  };
  const Sum sum = parallel_reduce(
      executor, input.points.size(), "project_outside", Sum{},
      [&](uint32_t i) {
        moved[i] = input.points[i];
        Sum one;
        one.before = projector.contact(to_double(moved[i])).depth;
        if (one.before <= 0) return Sum{};
        one.inside = 1;
        one.left = std::max(0.0, projector.move_out(moved[i]));
        one.still = one.left > 0;
        return one;
      },
      combine);
  ProjectFigures figures;
  figures.deepest_before = sum.before;
  figures.deepest_left = sum.left;
  figures.inside = sum.inside;
  figures.left = sum.still;
  if (input.samples > 1 && !input.triangles.empty() && !input.colliders.empty()) {
    figures.deepest_sample = push_samples(executor, input, projector, moved);
    const Sum after = parallel_reduce(
        executor, input.points.size(), "project_check", Sum{},
        [&](uint32_t i) {
          const double depth = std::max(0.0, projector.contact(to_double(moved[i])).depth);
          return Sum{0, depth, 0, depth > 0 ? size_t{1} : size_t{0}};
        },
        combine);
    figures.deepest_left = after.left;
    figures.left = after.still;
  }
  figures.moved = reduce_sum(executor, input.points.size(), "project_moved",
                             [&](uint32_t i) -> size_t { return std::memcmp(&moved[i], &input.points[i], sizeof(Vec3f)) != 0; });
  return figures;
}

}  // namespace knead
