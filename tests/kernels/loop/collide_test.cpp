#include "kernels/loop/collide.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "graph/error.h"
#include "io/vdb/vdb.h"
#include "kernels/loop/collide_launch.h"
#include "kernels/shapes/primitives.h"
#include "kernels/surface/mesh_distance.h"

namespace {

using knead::CollideInput;
using knead::ContactProgress;
using knead::MeshDistance;
using knead::ProjectFigures;
using knead::ProjectInput;
using knead::Sdf;
using knead::Similarity;
using knead::Surface;
using knead::Vec3d;
using knead::Vec3f;

// A solid ball as an analytic field: no mesh behind it.
Sdf collide_ball(double radius, double voxel, const Vec3d& at = {0, 0, 0}) {
  const auto executor = knead::make_serial_executor();
  knead::SdfPlan plan;
  plan.voxel_size = voxel;
  plan.lower = {-radius, -radius, -radius};
  plan.upper = {radius, radius, radius};
  Sdf sdf = knead::build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) { return length(p) - radius; });
  sdf.placement.translation = at;
  return sdf;
}

struct CollideMesh {
  Sdf sdf;
  std::unique_ptr<MeshDistance> mesh;

  CollideMesh(const Surface& surface, double voxel) {
    const auto executor = knead::make_serial_executor();
    mesh = std::make_unique<MeshDistance>(surface.points.host(), std::span<const uint32_t>(surface.topology->triangles));
    knead::SdfPlan plan;
    plan.voxel_size = voxel;
    plan.lower = mesh->lower();
    plan.upper = mesh->upper();
    sdf = knead::build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t& hint) { return mesh->signed_distance_near(p, hint).distance; });
  }
};

struct CollideOnce {
  std::vector<Vec3f> displacement;
  std::vector<float> memory;
  ContactProgress figures;

  CollideOnce(const std::vector<Vec3f>& points, const std::vector<const Sdf*>& colliders, const Similarity& placement = {},
              std::vector<float> before = {}, double margin = 0, double most = 1e9) {
    const auto executor = knead::make_serial_executor();
    displacement.resize(points.size());
    memory.resize(points.size());
    CollideInput input;
    input.points = points;
    input.memory = before;
    input.placement = placement;
    input.colliders = colliders;
    input.margin = margin;
    input.most = most;
    knead::collide_push(*executor, input, displacement.data(), memory.data(), &figures);
  }
};

std::vector<Vec3f> collide_cloud(size_t n, double half, uint32_t seed = 3) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> value(static_cast<float>(-half), static_cast<float>(half));
  std::vector<Vec3f> points(n);
  for (Vec3f& p : points) p.x = value(random), p.y = value(random), p.z = value(random);
  return points;
}

Similarity collide_placement(double scale) {
  // A turn by 0.7 about a skew axis.
  const Vec3d axis = Vec3d{1, 2, -0.5} * (1 / length(Vec3d{1, 2, -0.5}));
  const double c = std::cos(0.7), s = std::sin(0.7), t = 1 - c;
  Similarity placement;
  placement.scale = scale;
  placement.rotation = {t * axis.x * axis.x + c,          t * axis.x * axis.y - s * axis.z, t * axis.x * axis.z + s * axis.y,
                        t * axis.x * axis.y + s * axis.z, t * axis.y * axis.y + c,          t * axis.y * axis.z - s * axis.x,
                        t * axis.x * axis.z - s * axis.y, t * axis.y * axis.z + s * axis.x, t * axis.z * axis.z + c};
  placement.translation = Vec3d{0.3, -0.2, 0.1} * scale;
  return placement;
}

TEST(Collide, PushesByThePenetrationAndLeavesTheRestAlone) {
  const Sdf ball = collide_ball(1, 0.05);
  const std::vector<Vec3f> points = collide_cloud(3000, 1.4);
  const CollideOnce once(points, {&ball});
  double deepest = 0;
  size_t inside = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const double r = length(to_double(points[i]));
    if (r > 1.005) {
      ASSERT_EQ(length(once.displacement[i]), 0);
      ASSERT_EQ(once.memory[i], 0);
    }
    if (r < 0.995 && r > 0.1) {
      ASSERT_NEAR(length(to_double(points[i]) + to_double(once.displacement[i])), 1, 0.005);
      ASSERT_GT(dot(once.displacement[i], points[i]), 0.99f * length(once.displacement[i]) * length(points[i]));
    }
    inside += r < 1;
    deepest = std::max(deepest, 1 - r);
  }
  EXPECT_NEAR(once.figures.deepest, deepest, 0.01);
  EXPECT_NEAR(static_cast<double>(once.figures.inside), static_cast<double>(inside), 20);
}

TEST(Collide, DoesNotLookAtVerticesThatAreFarAndSoChangesNoBit) {
  const Sdf ball = collide_ball(0.5, 0.05, {0.4, 0, 0}), small = collide_ball(0.2, 0.03, {-0.5, 0.2, 0.1});
  const std::vector<const Sdf*> colliders{&ball, &small};
  std::vector<Vec3f> points = collide_cloud(20000, 1.5);
  points.push_back({NAN, 0, 0});
  const auto executor = knead::make_serial_executor();
  const std::vector<Vec3f> stand_back{{0.5f, 0, 0}, {0, 0, 0.4f}};
  ContactProgress before;
  before.step = 3;
  before.steps = 10;
  std::vector<float> memory(points.size(), 0.0f);
  for (size_t i = 0; i < memory.size(); i += 7) memory[i] = 0.02f;
  CollideInput input;
  input.points = points;
  input.memory = memory;
  input.placement = collide_placement(1.3);
  input.colliders = colliders;
  input.margin = 0.02;
  input.most = 0.3;
  input.before = &before;
  input.stand_back = stand_back;
  knead::ManyColliders many;
  knead::CollidePush quick = knead::make_push(*executor, input, many), thorough = quick;
  std::vector<Vec3f> moves(points.size()), all_moves(points.size());
  std::vector<float> kept(points.size()), all_kept(points.size());
  quick.displacement = moves.data(), thorough.displacement = all_moves.data();
  quick.memory_out = kept.data(), thorough.memory_out = all_kept.data();
  for (int k = 0; k < 2; ++k) thorough.few[k].lower = {-1e30f, -1e30f, -1e30f}, thorough.few[k].upper = {1e30f, 1e30f, 1e30f};
  size_t far = 0;
  for (uint32_t i = 0; i < points.size(); ++i) {
    const knead::ContactFigures one = quick(i), all = thorough(i);
    ASSERT_EQ(one.deepest, all.deepest);
    ASSERT_EQ(one.inside, all.inside);
    ASSERT_EQ(one.pushed, all.pushed);
    far += quick.is_far(points[i], quick.way_left());
  }
  EXPECT_EQ(std::memcmp(moves.data(), all_moves.data(), moves.size() * sizeof(Vec3f)), 0);
  EXPECT_EQ(std::memcmp(kept.data(), all_kept.data(), kept.size() * sizeof(float)), 0);
  EXPECT_GT(far, points.size() / 2);
  EXPECT_LT(far, points.size());
}

TEST(Collide, GivesTheSamePushInAnyPlaceAndAtAnyScale) {
  const std::vector<Vec3f> points = collide_cloud(500, 1.2);
  const Sdf ball = collide_ball(1, 0.05);
  const CollideOnce here(points, {&ball});
  for (const double scale : {1e-4, 1.0, 1e6}) {
    Sdf there = ball;
    const Similarity placement = collide_placement(scale);
    there.placement = placement;
    const CollideOnce moved(points, {&there}, placement);
    for (size_t i = 0; i < points.size(); ++i) ASSERT_LT(length(moved.displacement[i] - here.displacement[i]), 2e-4f);
    EXPECT_NEAR(moved.figures.deepest, here.figures.deepest, 1e-5);
  }
}

TEST(Collide, PushesOutOfTheDeepestOfSeveral) {
  const Sdf left = collide_ball(1, 0.05, {-0.5, 0, 0}), right = collide_ball(1, 0.05, {0.5, 0, 0}), far = collide_ball(1, 0.05, {9, 0, 0});
  const std::vector<Vec3f> points{{-0.9f, 0.2f, 0}, {0.9f, 0, 0.2f}, {0, 0, 1.2f}, {8.6f, 0.1f, 0}};
  const CollideOnce all(points, {&left, &right, &far});
  const CollideOnce one(points, {&left}), two(points, {&right}), three(points, {&far});
  EXPECT_EQ(length(all.displacement[0] - one.displacement[0]), 0);
  EXPECT_EQ(length(all.displacement[1] - two.displacement[1]), 0);
  EXPECT_EQ(length(all.displacement[2]), 0);
  EXPECT_EQ(length(all.displacement[3] - three.displacement[3]), 0);
}

TEST(Collide, RemembersContactAndLetsGo) {
  const Sdf ball = collide_ball(1, 0.05);
  const std::vector<Vec3f> inside{{0.9f, 0, 0}}, outside{{1.03f, 0, 0}}, beyond{{3, 0, 0}};
  const CollideOnce first(inside, {&ball});
  EXPECT_NEAR(first.memory[0], 0.1f, 0.003f);
  const CollideOnce second(inside, {&ball}, {}, first.memory);
  EXPECT_NEAR(second.memory[0], 0.2f, 0.006f);
  EXPECT_NEAR(length(second.displacement[0]), 0.2f, 0.006f);
  const CollideOnce third(outside, {&ball}, {}, second.memory);  // out by 0.03: decays by that much, and still holds
  EXPECT_NEAR(third.memory[0], 0.17f, 0.006f);
  EXPECT_NEAR(third.displacement[0].x, 0.17f, 0.006f);
  CollideOnce gone(beyond, {&ball}, {}, third.memory);  // outside the band there is no direction: no push, and the memory fades within a step
  EXPECT_EQ(length(gone.displacement[0]), 0);
  EXPECT_EQ(gone.memory[0], 0);
  EXPECT_EQ(gone.figures.pushed, 0u);
}

TEST(Collide, BoundsItsMemory) {
  const Sdf ball = collide_ball(1, 0.05);
  const std::vector<Vec3f> inside{{0.5f, 0, 0}};
  std::vector<float> memory;
  for (int k = 0; k < 20; ++k) memory = CollideOnce(inside, {&ball}, {}, memory, 0, 0.7).memory;
  EXPECT_FLOAT_EQ(memory[0], 0.7f);
}

TEST(Collide, KeepsAMarginAndRefusesOneBeyondTheBand) {
  const Sdf ball = collide_ball(1, 0.05);
  const std::vector<Vec3f> points{{1.04f, 0, 0}, {1.2f, 0, 0}, {5, 0, 0}};
  const CollideOnce once(points, {&ball}, {}, {}, 0.08);
  EXPECT_NEAR(once.displacement[0].x, 0.04f, 0.003f);
  EXPECT_EQ(length(once.displacement[1]), 0);
  EXPECT_EQ(length(once.displacement[2]), 0);
  EXPECT_THROW(CollideOnce(points, {&ball}, {}, {}, 0.3), knead::Error);
}

TEST(Collide, ChoosesADirectionAtTheVeryCentre) {
  const Sdf ball = collide_ball(1, 0.1);
  const CollideOnce once({{0, 0, 0}, {NAN, 0, 0}}, {&ball});
  EXPECT_NEAR(length(once.displacement[0]), 1, 0.1);
  EXPECT_EQ(length(once.displacement[1]), 0);  // what is not a number is nowhere
}

TEST(Collide, IsTheSameBitsForAnyNumberOfThreads) {
  const Sdf ball = collide_ball(1, 0.1);
  const std::vector<Vec3f> points = collide_cloud(5000, 1.2);
  const CollideOnce once(points, {&ball});
  const auto two = knead::make_cpu_executor(2);
  std::vector<Vec3f> displacement(points.size());
  std::vector<float> memory(points.size());
  CollideInput input;
  input.points = points;
  const std::vector<const Sdf*> colliders{&ball};
  input.colliders = colliders;
  input.most = 1e9;
  ContactProgress figures;
  knead::collide_push(*two, input, displacement.data(), memory.data(), &figures);
  EXPECT_EQ(std::memcmp(displacement.data(), once.displacement.data(), displacement.size() * sizeof(Vec3f)), 0);
  EXPECT_EQ(memory, once.memory);
}

TEST(Project, LeavesNothingInsideTheMeshEvenAtSharpEdges) {
  const Surface box = knead::make_box({1, 1, 1}, 4);
  const CollideMesh collider(box, 0.1);  // coarse on purpose: the grid cuts the box's edges by tenths of a voxel
  const std::vector<Vec3f> points = collide_cloud(4000, 0.7);
  const auto executor = knead::make_cpu_executor(2);
  std::vector<Vec3f> moved(points.size());
  const std::vector<const Sdf*> colliders{&collider.sdf};
  const std::vector<const knead::ExactDistance*> meshes{collider.mesh.get()};
  ProjectInput input;
  input.points = points;
  input.colliders = colliders;
  input.meshes = meshes;
  input.clearance = 1e-6;
  const ProjectFigures figures = knead::project_outside(*executor, input, moved.data());
  EXPECT_EQ(figures.left, 0u);
  for (size_t i = 0; i < points.size(); ++i) {
    const double before = collider.mesh->signed_distance(to_double(points[i])).distance,
                 after = collider.mesh->signed_distance(to_double(moved[i])).distance;
    ASSERT_GE(after, 0);
    if (before >= 0) {
      ASSERT_EQ(std::memcmp(&moved[i], &points[i], sizeof(Vec3f)), 0);
    } else {
      ASSERT_NEAR(length(to_double(moved[i]) - to_double(points[i])), -before, 3e-6);  // the nearest place outside
    }
  }
}

TEST(Project, WorksAgainstAFieldWithoutAMesh) {
  const Sdf ball = collide_ball(1, 0.05);
  const std::vector<Vec3f> points = collide_cloud(2000, 1.1);
  const auto executor = knead::make_serial_executor();
  std::vector<Vec3f> moved(points.size());
  const std::vector<const Sdf*> colliders{&ball};
  ProjectInput input;
  input.points = points;
  input.colliders = colliders;
  input.clearance = 1e-6;
  const ProjectFigures figures = knead::project_outside(*executor, input, moved.data());
  EXPECT_EQ(figures.left, 0u);
  const CollideOnce after(moved, {&ball});
  EXPECT_LT(after.figures.deepest, 1e-6);
}

TEST(Project, ReportsWhatIsSqueezedBetweenColliders) {
  // Out of one ball leads into the other: the first try cannot do, more of them find the notch where the balls meet.
  const Sdf left = collide_ball(1, 0.05, {-0.6, 0, 0}), right = collide_ball(1, 0.05, {0.6, 0, 0});
  const std::vector<Vec3f> points{{0.05f, 0.5f, 0}, {3, 0, 0}};
  const auto executor = knead::make_serial_executor();
  std::vector<Vec3f> moved(points.size());
  const std::vector<const Sdf*> colliders{&left, &right};
  ProjectInput input;
  input.points = points;
  input.colliders = colliders;
  input.clearance = 1e-6;
  input.rounds = 2;
  const ProjectFigures squeezed = knead::project_outside(*executor, input, moved.data());
  EXPECT_EQ(squeezed.inside, 1u);
  EXPECT_EQ(squeezed.left, 1u);
  EXPECT_GT(squeezed.deepest_left, 0.01);
  EXPECT_LE(squeezed.deepest_left, squeezed.deepest_before);
  input.rounds = 500;
  const ProjectFigures out = knead::project_outside(*executor, input, moved.data());
  EXPECT_EQ(out.left, 0u);
  EXPECT_EQ(CollideOnce(moved, {&left, &right}).figures.deepest, 0);
  EXPECT_EQ(std::memcmp(&moved[1], &points[1], sizeof(Vec3f)), 0);
}

TEST(Project, KeepsFacesOutsideWhenAskedForSamples) {
  const Surface ball = knead::make_sphere(0.3, 4);
  const CollideMesh collider(ball, 0.02);
  Surface plate = knead::make_box({2, 0.2, 2}, 8);  // its top cuts the ball with all vertices outside it or nearly so
  std::vector<Vec3f> points(plate.points.host().begin(), plate.points.host().end());
  for (Vec3f& p : points) p = p + Vec3f{0.11f, -0.3f, 0.07f};
  const auto executor = knead::make_serial_executor();
  std::vector<Vec3f> moved(points.size());
  const std::vector<const Sdf*> colliders{&collider.sdf};
  const std::vector<const knead::ExactDistance*> meshes{collider.mesh.get()};
  auto deepest_in_faces = [&](const std::vector<Vec3f>& at) {
    double deepest = 0;
    for (size_t t = 0; t < plate.topology->triangles.size(); t += 3)
      for (int i = 0; i <= 8; ++i)
        for (int j = 0; i + j <= 8; ++j) {
          const Vec3d a = to_double(at[plate.topology->triangles[t]]), b = to_double(at[plate.topology->triangles[t + 1]]),
                      c = to_double(at[plate.topology->triangles[t + 2]]);
          deepest = std::max(deepest, -collider.mesh->signed_distance(c + (a - c) * (i / 8.0) + (b - c) * (j / 8.0)).distance);
        }
    return deepest;
  };
  ProjectInput input;
  input.points = points;
  input.colliders = colliders;
  input.meshes = meshes;
  input.clearance = 1e-6;
  input.triangles = plate.topology->triangles;
  knead::project_outside(*executor, input, moved.data());
  EXPECT_GT(deepest_in_faces(moved), 0.01);
  input.samples = 8;
  const ProjectFigures figures = knead::project_outside(*executor, input, moved.data());
  EXPECT_LT(deepest_in_faces(moved), 2e-6);
  EXPECT_LE(figures.deepest_sample, input.clearance);
  EXPECT_EQ(figures.left, 0u);
  for (input.rounds = 1; input.rounds < 12;
       ++input.rounds) {  // what is told is of the places that come out, though only pushed faces are looked at again
    const ProjectFigures early = knead::project_outside(*executor, input, moved.data());
    EXPECT_NEAR(early.deepest_sample, deepest_in_faces(moved), 1e-9) << input.rounds;
  }
}

}  // namespace
