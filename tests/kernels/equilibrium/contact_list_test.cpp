// Which samples are looked at, and when: leaving others out, and remembering what is known of a place, must not change what contacts do.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

#include "io/vdb/vdb.h"
#include "kernels/equilibrium/contact_samples_body.h"
#include "kernels/loop/collide.h"

namespace knead {
namespace contact_list_test {

constexpr float kRadius = 1, kSkin = 0.2f;

// Samples around a ball, each with a vertex of H of its own; the last ones ride outside of H, moving against a second vertex.
struct Around {
  Sdf sdf;
  std::vector<Row4> u, force, normal;
  std::vector<uint32_t> offsets{0}, indices, list;
  std::vector<float> weights, area, multiplier, distance, slack;
  std::vector<Vec3f> rest;
  float travelled = 0;
  ContactSum result;
  ColliderView view{};
  ContactEnergy body{};

  Around() {
    const auto executor = make_serial_executor();
    SdfPlan plan;
    plan.voxel_size = kRadius / 12;
    plan.lower = {-kRadius, -kRadius, -kRadius};
    plan.upper = {kRadius, kRadius, kRadius};
    sdf = build_sdf(*executor, plan, [&](const Vec3d& p, uint32_t&) { return length(p) - kRadius; });
    constexpr uint32_t kSamples = 3000, kOutside = 300;
    std::mt19937 random(3);
    std::uniform_real_distribution<float> coordinate(-4, 4);
    for (uint32_t s = 0; s < kSamples; ++s) {
      rest.push_back({coordinate(random), coordinate(random), coordinate(random)});
      indices.push_back(s);
      weights.push_back(s + kOutside < kSamples ? 1.0f : 3.0f);
      if (weights.back() > 1) {
        indices.push_back(kSamples);
        weights.push_back(-2.0f);
      }
      offsets.push_back(static_cast<uint32_t>(indices.size()));
    }
    u.assign(kSamples + 1, Row4{0, 0, 0, 0});
    force.assign(kSamples, Row4{7, 7, 7, 0});
    normal.assign(kSamples, Row4{0, 0, 0, 0});
    area.assign(kSamples, 1);
    multiplier.assign(kSamples, 0);
    distance.assign(kSamples, 0);
    slack.assign(kSamples, 0);
    body.u = u.data();
    body.offsets = offsets.data();
    body.indices = indices.data();
    body.weights = weights.data();
    body.rest = rest.data();
    body.area = area.data();
    body.multiplier = multiplier.data();
    body.distance = distance.data();
    body.force = force.data();
    body.normal = normal.data();
    body.slack = slack.data();
    body.travelled = &travelled;
    body.result = &result;
    view = view_collider(sdf, Device{}, Similarity{});
    body.colliders = &view;
    body.count = 1;
    body.samples = kSamples;
    body.stiffness = 30;
    body.law.gap = 0.02f;
    body.law.gentle = 0.5f;
  }
  void make_list(float since) {
    for (uint32_t s = 0; s < body.samples; ++s) ContactRoom{body, slack.data(), kSkin, since}(s);
    list.clear();
    for (uint32_t s = 0; s < body.samples; ++s)
      if (slack[s] < kSkin) list.push_back(s);
  }
  ContactSum sum(bool listed) {
    ContactSum sum;
    if (listed) {
      for (const uint32_t s : list) sum = ContactEnergy::combine(sum, body(s));
    } else {
      for (uint32_t s = 0; s < body.samples; ++s) sum = ContactEnergy::combine(sum, body(s));
    }
    return sum;
  }
  void update_multipliers() {
    UpdateMultiplier update{body, multiplier.data(), slack.data(), nullptr};
    update.contact.list = list.data();
    for (uint32_t i = 0; i < list.size(); ++i) update(i);
  }
};

void expect_same(const ContactSum& a, const ContactSum& b) {
  EXPECT_EQ(a.active, b.active);
  EXPECT_NEAR(a.energy, b.energy, 1e-5 * b.energy);
  EXPECT_FLOAT_EQ(a.deepest, b.deepest);
  EXPECT_NEAR(a.change, b.change, 1e-6f);
}

TEST(ContactList, WhatIsLeftOutHasNoForce) {
  Around listed, all;
  std::mt19937 random(4);
  std::uniform_real_distribution<float> coordinate(-1, 1);
  std::vector<Vec3f> drift;
  for (const Vec3f& at : listed.rest)
    drift.push_back((-0.02f / length(at)) * at + 0.01f * Vec3f{coordinate(random), coordinate(random), coordinate(random)});
  drift.push_back({0, 0.03f, 0});
  listed.make_list(-1);
  size_t most = 0, pushed = 0;
  for (int step = 0; step < 160; ++step) {  // all come in, past the ball's middle and out, and back again
    listed.travelled += 0.05f;              // more than the drift
    for (size_t p = 0; p < drift.size(); ++p) listed.u[p] = all.u[p] = to_row(to_vec(listed.u[p]) + (step < 80 ? 1.0f : -1.0f) * drift[p]);
    if (listed.travelled >= kSkin) {
      listed.make_list(listed.travelled);
      listed.travelled = 0;
    }
    std::fill(all.slack.begin(), all.slack.end(), 0.0f);
    const ContactSum few = listed.sum(true), every = all.sum(false);
    expect_same(few, every);
    for (uint32_t s = 0; s < all.body.samples; ++s) ASSERT_EQ(listed.force[s].x, all.force[s].x) << step << ' ' << s;
    most = std::max(most, listed.list.size());
    pushed = std::max(pushed, size_t{few.active});
    if (step % 20 == 19) {
      listed.update_multipliers();
      all.list.resize(all.body.samples);
      std::iota(all.list.begin(), all.list.end(), 0u);
      all.update_multipliers();
    }
  }
  EXPECT_GT(pushed, 100u);
  EXPECT_LT(most, listed.body.samples / 2);
}

TEST(ContactList, APositionThatIsKnownIsNotLookedUpAgain) {
  Around here;
  here.make_list(-1);
  ASSERT_GT(here.sum(true).active, 10u);
  here.update_multipliers();
  here.body.stiffness *= 2;
  const ContactSum whole = here.sum(true);
  const std::vector<Row4> force = here.force;
  here.body.known = 1;
  here.view.sdf.grid = nullptr;
  expect_same(here.sum(true), whole);
  for (const uint32_t s : here.list) ASSERT_NEAR(here.force[s].x, force[s].x, 1e-5f * (1 + std::abs(force[s].x)));
}

TEST(ContactList, AMultiplierIsForgottenWhereTheFieldIsFlat) {
  Around here;
  here.multiplier[0] = here.multiplier[1] = 2;
  here.u[0] = to_row(Vec3f{0.9f, 0, 0} - here.rest[0]);
  here.u[1] = to_row(Vec3f{0, 3, 0} - here.rest[1]);  // let through: beyond the band, though not as far as the memory is long
  here.make_list(-1);
  here.sum(true);
  EXPECT_LT(here.distance[1], 2);
  here.update_multipliers();
  EXPECT_GT(here.multiplier[0], 2);
  EXPECT_EQ(here.multiplier[1], 0);
}

}  // namespace contact_list_test
}  // namespace knead
