#include "io/picture/light.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace knead {

namespace {

constexpr float kKeyRadius = 0.17f;  // of the light's disc at distance 1: soft shadows
constexpr float kSkyReach = 0.7f;    // how far ambient occlusion looks; the frame is about 2 wide
constexpr float kSkin = 0.012f;      // light enters flesh this deep, so shadows on it start softly
constexpr float kOffset = 2e-4f;     // off the surface, against hitting it again

Vec3f unit(const Vec3f& v) {
  return v * (1 / length(v));
}

// Two directions that span the plane across n (Duff et al. 2017, "Building an orthonormal basis, revisited").
void basis(const Vec3f& n, Vec3f& a, Vec3f& b) {
  const float sign = std::copysign(1.0f, n.z), s = -1 / (sign + n.z), t = n.x * n.y * s;
  a = {1 + sign * n.x * n.x * s, sign * t, -sign * n.x};
  b = {t, sign + n.y * n.y * s, -n.y};
}

// Member i of the R2 sequence (M. Roberts 2018) in the unit square.
void sample(uint32_t i, float& u, float& v) {
  const auto fraction = [](double x) { return static_cast<float>(x - std::floor(x)); };
  u = fraction(0.5 + 0.7548776662466927 * i);
  v = fraction(0.5 + 0.5698402909980532 * i);
}

float power5(float x) {
  return x * x * x * x * x;
}

// GGX with Schlick's Fresnel and a cheap visibility term, times n.l.
float gloss(const Vec3f& n, const Vec3f& l, const Vec3f& v, float roughness, float reflectance) {
  const float nl = dot(n, l);
  if (nl <= 0) return 0;
  const Vec3f h = unit(l + v);
  const float nh = std::max(0.0f, dot(n, h)), lh = std::max(0.0f, dot(l, h));
  const float a2 = roughness * roughness * roughness * roughness, k = nh * nh * (a2 - 1) + 1;
  const float spread = a2 / (std::numbers::pi_v<float> * k * k), fresnel = reflectance + (1 - reflectance) * power5(1 - lh);
  return nl * spread * fresnel / (4 * std::max(0.1f, lh * lh));
}

}  // namespace

Colour mix(const Colour& a, const Colour& b, float t) {
  return {a.r + t * (b.r - a.r), a.g + t * (b.g - a.g), a.b + t * (b.b - a.b)};
}

uint8_t to_byte(float linear) {
  static const std::array<uint8_t, 4097> table = [] {
    std::array<uint8_t, 4097> t{};
    for (int i = 0; i <= 4096; ++i) {
      const double x = 2.0 * i / 4096, v = x < 0.7 ? x : 1 - 0.3 * std::exp(-(x - 0.7) / 0.3);  // highlights roll off
      t[static_cast<size_t>(i)] = static_cast<uint8_t>(std::lround(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055)));
    }
    return t;
  }();
  return table[static_cast<size_t>(std::lround(std::clamp(linear, 0.0f, 2.0f) * 2048))];
}

Studio::Studio(const Vec3f& right, const Vec3f& up, const Vec3f& back, const Vec3f& sky_up)
    : key_(unit(-0.62f * right + 0.80f * up + 0.62f * back)), fill_(unit(0.85f * right + 0.15f * up + 0.55f * back)), sky_up_(sky_up) {}

Exposure Studio::gather(const RenderScene& scene, const RenderHit& hit, bool flesh, int rays, uint32_t index) const {
  Vec3f to_key[8], to_sky[8], a, b, c, d;
  basis(key_, a, b);
  basis(hit.normal, c, d);
  int sky_rays = 0;
  for (int i = 0; i < rays; ++i) {
    float u, v;
    sample(index * static_cast<uint32_t>(rays) + static_cast<uint32_t>(i), u, v);
    const float angle = 2 * std::numbers::pi_v<float> * v, r = std::sqrt(u), across = std::cos(angle) * r, along = std::sin(angle) * r;
    to_key[i] = unit(key_ + kKeyRadius * (across * a + along * b));
    const Vec3f sky = unit(across * c + along * d + std::sqrt(std::max(0.0f, 1 - u)) * hit.normal);
    if (dot(sky, hit.facet) > 0.02f) to_sky[sky_rays++] = sky;
  }
  Exposure exposure;
  const Vec3f origin = hit.lifted + kOffset * hit.facet;
  // A plain surface that faces away is dark whatever lies between.
  const float facing = dot(hit.normal, key_);
  if (facing > (flesh ? -0.45f : 0.0f)) {
    const Vec3f start = flesh ? origin + kSkin * hit.normal : origin;
    exposure.key = 1 - static_cast<float>(__builtin_popcount(scene.blocked(start, to_key, rays, 100))) / static_cast<float>(rays);
  }
  exposure.sky = 1 - static_cast<float>(__builtin_popcount(scene.blocked(origin, to_sky, sky_rays, kSkyReach))) / static_cast<float>(rays);
  return exposure;
}

Colour Studio::shade(const RenderHit& hit, const Vec3f& to_eye, const Colour& albedo, Material material, const Exposure& exposure) const {
  const bool flesh = material == Material::kFlesh;
  // Light bleeds around the terminator of flesh, red furthest; shadows on it are warm for the same reason.
  const float wrap[3] = {flesh ? 0.42f : 0.10f, flesh ? 0.18f : 0.10f, flesh ? 0.10f : 0.10f};
  const float bleed[3] = {flesh ? 0.75f : 1.0f, flesh ? 1.05f : 1.0f, flesh ? 1.15f : 1.0f};
  const float key_light[3] = {1.16f, 1.10f, 1.01f}, fill_light[3] = {0.15f, 0.17f, 0.20f};
  const float sky_light[3] = {0.31f, 0.335f, 0.37f}, floor_light[3] = {0.19f, 0.165f, 0.15f};
  const float nl = dot(hit.normal, key_), nf = std::max(0.0f, dot(hit.normal, fill_)), upward = 0.5f + 0.5f * dot(hit.normal, sky_up_);
  const float colour[3] = {albedo.r, albedo.g, albedo.b};
  float out[3];
  const float facing = std::max(0.0f, dot(hit.normal, to_eye));
  const float edge = power5(1 - facing);
  float shine = 0;
  if (flesh)
    shine = exposure.key * (0.75f * gloss(hit.normal, key_, to_eye, 0.46f, 0.028f) + 0.35f * gloss(hit.normal, key_, to_eye, 0.28f, 0.028f));
  else
    shine = exposure.key * (material == Material::kCollider ? 0.9f : 0.4f) * gloss(hit.normal, key_, to_eye, 0.38f, 0.04f);
  for (int c = 0; c < 3; ++c) {
    const float spread = std::max(0.0f, (nl + wrap[c]) / (1 + wrap[c]));
    const float key = key_light[c] * spread * std::pow(exposure.key, bleed[c]);
    // Light that bounces in a crease takes on the surface's colour (Jimenez et al. 2016, "Practical real-time strategies for accurate indirect
    // occlusion").
    const float s = exposure.sky, p = 2.0404f * colour[c] - 0.3324f, q = -4.7951f * colour[c] + 0.6417f, r = 2.7552f * colour[c] + 0.6903f;
    const float sky = std::max(s, ((s * p + q) * s + r) * s);
    const float around = sky * (floor_light[c] + upward * (sky_light[c] - floor_light[c]));
    out[c] = colour[c] * (key + fill_light[c] * nf * sky + around) + key_light[c] * shine + 0.30f * sky_light[c] * edge * exposure.sky;
  }
  return {out[0], out[1], out[2]};
}

Colour Studio::shade_ghost(const RenderHit& hit, const Vec3f& to_eye, const Colour& albedo, float& cover) const {
  const float facing = std::clamp(dot(hit.normal, to_eye), 0.0f, 1.0f);
  cover = 0.14f + 0.60f * (1 - facing) * (1 - facing);
  return shade(hit, to_eye, albedo, Material::kCollider, {1, 1});
}

}  // namespace knead
