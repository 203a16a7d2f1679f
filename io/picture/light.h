// Light and materials of a picture. Linear colours, directions are unit vectors, render space.
#pragma once
#include "io/picture/picture.h"
#include "io/picture/scene.h"

namespace knead {

enum class Material { kFlesh, kPlain, kCollider };

// What reaches a point: the share of the key light's disc and of the sky that it sees, 0 to 1.
struct Exposure {
  float key = 1, sky = 1;
};

// Lights stand with the camera, so that every view is lit alike: a key from the upper left, a weak fill from the right, a sky above.
class Studio {
 public:
  Studio(const Vec3f& right, const Vec3f& up, const Vec3f& back, const Vec3f& sky_up);

  // `rays` (1 to 8) towards the key light and as many into the sky, members `index` of a low-discrepancy sequence, so that the 16 pixels of a 4 x 4
  // tile, with indices 0 to 15, share 16 * rays well-spread directions.
  Exposure gather(const RenderScene& scene, const RenderHit& hit, bool flesh, int rays, uint32_t index) const;

  Colour shade(const RenderHit& hit, const Vec3f& to_eye, const Colour& albedo, Material material, const Exposure& exposure) const;
  // A see-through collider: its colour, and how much it covers in `cover`.
  Colour shade_ghost(const RenderHit& hit, const Vec3f& to_eye, const Colour& albedo, float& cover) const;

 private:
  Vec3f key_, fill_, sky_up_;
};

Colour mix(const Colour& a, const Colour& b, float t);
uint8_t to_byte(float linear);  // sRGB with a soft shoulder

}  // namespace knead
