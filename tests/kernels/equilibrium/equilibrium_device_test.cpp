// The equilibrium on devices, against the cpu executor. Both descend the same energy by the same bodies; they differ by the order of sums, so by roundings,
// which a descent does not add up: it ends where the forces balance.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "graph/error.h"
#include "io/vdb/vdb.h"
#include "kernels/build_tets/build_tets.h"
#include "kernels/equilibrium/energy_sums.h"
#include "kernels/equilibrium/equilibrium.h"
#include "kernels/shapes/primitives.h"
#include "tests/kernels/on_device.h"

namespace knead {
namespace equilibrium_device_test {

using on_device::back;
using on_device::moved;

Sdf ball(double radius, const Vec3d& at) {
  const auto executor = make_serial_executor();
  SdfPlan plan;
  plan.voxel_size = radius / 12;
  plan.lower = {-radius, -radius, -radius};
  plan.upper = {radius, radius, radius};
  Sdf sdf = build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) { return length(p) - radius; });
  sdf.placement.translation = at;
  return sdf;
}

struct Scene {
  BuiltTets built;
  std::vector<Sdf> colliders;
  EquilibriumMaterial material;
  EquilibriumSettings settings;
  double diagonal = 0;  // cells

  explicit Scene(std::vector<Sdf> of, const Surface& surface = make_sphere(1, 2), int depth = 3, int least = 3) : colliders(std::move(of)) {
    std::vector<std::string> warnings;
    BuildTetsOptions options;
    options.max_depth = depth;
    options.min_depth = least;
    built = build_tets(surface, options, *make_cpu_executor(2), warnings);
    settings.max_iterations = 300;
    diagonal = built.lattice.rest.diagonal() / built.lattice.to_local.scale;
  }

  std::vector<Vec3f> on(Executor& executor, EquilibriumFigures& figures) const {
    const bool far = executor.device() != Device{};
    const auto rest = prepare_equilibrium(executor, built.tets, built.lattice, material);
    std::vector<Sdf> fields;
    for (const Sdf& sdf : colliders) fields.push_back(far ? moved(executor, sdf) : sdf);
    std::vector<const Sdf*> pointers;
    for (const Sdf& sdf : fields) pointers.push_back(&sdf);
    EquilibriumSettings asked = settings;
    asked.on_host = [&](size_t k) { return colliders[k]; };
    const Buffer<Vec3f> result = solve_equilibrium(executor, *rest, built.lattice.rest.placement, pointers, asked, figures);
    return far ? back(executor, result) : std::vector<Vec3f>(result.host().begin(), result.host().end());
  }
};

Sdf above(double height = 1.2) {
  return ball(0.5, {0.05, height, 0.02});
}

class EquilibriumOnDevice : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    device_ = on_device::device_named(GetParam());
    KNEAD_NEEDS(device_);
  }

  // Roundings leave up to 1e-7 of the diagonal on the fake device, 2e-6 in a crush. A descent that ended an iteration sooner would leave up to what
  // counts as rest, settings.displacement, 1e-4.
  void compare(const Scene& scene, const std::string& what) {
    constexpr double kApart = 1e-5, kDent = 0.02;  // of the diagonal
    const auto cpu = make_cpu_executor(2);
    EquilibriumFigures here, far;
    const std::vector<Vec3f> expected = scene.on(*cpu, here), result = scene.on(*device_, far);
    EXPECT_EQ(here.ended, Ended::kAtRest) << what;
    EXPECT_EQ(far.ended, here.ended) << what;
    EXPECT_EQ(far.undecided, here.undecided) << what;
    EXPECT_EQ(far.way_in, here.way_in) << what;
    EXPECT_EQ(far.contacts, here.contacts) << what;
    EXPECT_NEAR(far.iterations, here.iterations, 0.1 * here.iterations) << what;
    EXPECT_NEAR(far.energy, here.energy, 1e-5 * here.energy) << what;
    ASSERT_EQ(result.size(), expected.size());
    double apart = 0, dent = 0;
    for (size_t i = 0; i < result.size(); ++i) {
      apart = std::max(apart, static_cast<double>(length(result[i] - expected[i])) / scene.diagonal);
      dent = std::max(dent, static_cast<double>(length(expected[i] - scene.built.tets.rest.host()[i])) / scene.diagonal);
    }
    EXPECT_LT(apart, kApart) << what;
    EXPECT_GT(dent, kDent) << what;
  }

  std::unique_ptr<Executor> device_;
};

TEST_P(EquilibriumOnDevice, EndsAtTheHostsShapeWithEveryMaterial) {
  for (const ElasticTerm term : {ElasticTerm::kStableNeoHookean, ElasticTerm::kCorotated, ElasticTerm::kEdges}) {
    Scene scene({above()});
    scene.material.term = term;
    compare(scene, "material " + std::to_string(static_cast<int>(term)));
  }
}

TEST_P(EquilibriumOnDevice, EndsAtTheHostsShapeOnSeveralGridsBetweenSeveralColliders) {
  Scene scene({above(), ball(0.4, {0.1, -1.2, 0}), ball(0.3, {1.15, 0, 0})}, make_sphere(1, 3), 4);
  scene.colliders[0].placement.rotation = {0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, 1};
  scene.colliders[2].placement.rotation = {1, 0, 0, 0, 0.28, 0.96, 0, -0.96, 0.28};
  compare(scene, "three balls");
}

TEST_P(EquilibriumOnDevice, EndsAtTheHostsShapeFromDirectionsOfCoarseGrids) {
  Scene scene({above(), ball(0.4, {0.1, -1.2, 0})}, make_sphere(1, 5), 5, 4);
  ASSERT_GT(scene.built.tets.vertices(), 8000u);
  compare(scene, "a fine H");
}

TEST_P(EquilibriumOnDevice, EndsAtTheHostsShapeWithSamplesFrictionPinsAndPaint) {
  Scene sampled({above()});
  sampled.material.contact_samples = 4;
  compare(sampled, "samples inside faces");
  sampled.material.keep_volume = false;
  compare(sampled, "samples, volume not kept");
  Scene clinging({above()});
  clinging.settings.friction = 0.5;
  std::vector<float> pins, paint;
  for (const Vec3f& p : clinging.built.lattice.rest.points.host()) pins.push_back(p.y < -0.5f ? 1.0f : 0.0f), paint.push_back(p.x < 0 ? 0.3f : 1.0f);
  const Buffer<float> pinned(pins), painted(paint);
  clinging.material.pins = &pinned;
  clinging.material.stiffness_weights = &painted;
  compare(clinging, "friction and pins");
}

TEST_P(EquilibriumOnDevice, ComesInTheHostsWay) {
  compare(Scene({above(1.0)}), "half sunk");
  Scene deep({ball(0.3, {0, 0.85, 0})});
  deep.settings.threshold = 1e-4;  // on a long way roundings grow to what the rule of rest leaves
  deep.settings.penetration = 1e-6;
  compare(deep, "deep");
  Scene swept({above(1.0)});  // at 0.9 it takes 225 to 251 iterations, so that roundings part ways
  swept.material.hold = 20;
  swept.settings.entry = {0, -1, 0};
  swept.settings.friction = 0.3;
  swept.settings.threshold = 1e-4;
  compare(swept, "given entry");
}

TEST_P(EquilibriumOnDevice, CrushesAsTheHostDoes) {
  Scene scene({ball(1.2, {0, 1.6, 0}), ball(1.2, {0, -1.6, 0})});
  scene.settings.threshold = 1e-4;
  compare(scene, "crush");
  // The metric follows the shape at iteration 16: there, not by way of the host.
  EquilibriumFigures figures;
  uint64_t copied[2];
  for (const int more : {0, 1}) {
    scene.settings.max_iterations = 15 + 4 * more;
    const uint64_t before = on_device::figures_of(*device_).copied_bytes;
    scene.on(*device_, figures);
    copied[more] = on_device::figures_of(*device_).copied_bytes - before;
  }
  EXPECT_LT(copied[1], copied[0] + 40 * sizeof(EquilibriumSums));
}

TEST_P(EquilibriumOnDevice, ReadsBackOneSmallStructAnEvaluation) {
  Scene scene({above()}, make_sphere(1, 3), 4);
  scene.settings.threshold = scene.settings.displacement = 0;  // never at rest
  DeviceFigures figures[2];
  EquilibriumFigures of[2];
  for (const int many : {0, 1}) {
    const auto device = on_device::device_named(GetParam());
    scene.settings.max_iterations = many ? 32 : 12;
    scene.on(*device, of[many]);
    ASSERT_EQ(of[many].iterations, scene.settings.max_iterations);
    figures[many] = on_device::figures_of(*device);
  }
  const uint64_t copies = figures[1].copies - figures[0].copies;
  const auto looks = static_cast<uint64_t>(of[1].evaluations - of[0].evaluations + of[1].updates - of[0].updates);
  EXPECT_EQ(figures[1].copied_bytes - figures[0].copied_bytes, copies * sizeof(EquilibriumSums)) << "nothing else is transferred";
  EXPECT_GE(copies, looks);
  EXPECT_LE(copies, looks + 2) << "one more where contacts had to be listed anew";
  EXPECT_LT(sizeof(EquilibriumSums), 256u);
  EXPECT_LT(figures[1].launches - figures[0].launches, 90 * copies) << "launches do not grow with what is remembered";
}

TEST_P(EquilibriumOnDevice, GivesTheSameBitsAgainAndRestWhereNothingTouches) {
  const Scene scene({above()});
  EquilibriumFigures figures;
  const std::vector<Vec3f> first = scene.on(*device_, figures), again = scene.on(*device_, figures);
  EXPECT_EQ(std::memcmp(first.data(), again.data(), first.size() * sizeof(Vec3f)), 0);
  const std::vector<Vec3f> rest = Scene({above(3)}).on(*device_, figures);
  EXPECT_EQ(figures.ended, Ended::kNoContact);
  EXPECT_EQ(std::memcmp(rest.data(), scene.built.tets.rest.host().data(), rest.size() * sizeof(Vec3f)), 0);
}

TEST(EquilibriumForDevices, IsRefusedByAnotherExecutorThanItWasPreparedFor) {
  fake_device::FakeDevice fake;
  const Scene scene({above()});
  const auto rest = prepare_equilibrium(fake.executor, scene.built.tets, scene.built.lattice, scene.material);
  const std::vector<const Sdf*> colliders{&scene.colliders[0]};
  EquilibriumFigures figures;
  EXPECT_THROW(solve_equilibrium(*make_serial_executor(), *rest, {}, colliders, scene.settings, figures), Error);
}

TEST(EquilibriumForDevices, SaysWhenThereIsTooLittleMemory) {
  fake_device::FakeDevice fake(size_t{1} << 20);
  EquilibriumFigures figures;
  try {
    Scene({above()}).on(fake.executor, figures);
    FAIL() << "a megabyte was enough";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kMemory);
  }
}

INSTANTIATE_TEST_SUITE_P(Devices, EquilibriumOnDevice, testing::Values("fake", "cuda"), [](const auto& info) { return std::string(info.param); });

}  // namespace equilibrium_device_test
}  // namespace knead
