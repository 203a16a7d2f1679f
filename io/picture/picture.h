// Shaded pictures of a soft surface and the colliders that press it, ray-traced, and contact sheets of them. Deterministic for any number of threads.
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

struct Colour {
  float r = 0, g = 0, b = 0;  // linear, 0 to 1
};

// 8 bits of sRGB a channel, rows from the top.
struct Image {
  int width = 0, height = 0;
  std::vector<uint8_t> rgb;  // 3 * width * height
  Image() = default;
  Image(int w, int h) : width(w), height(h), rgb(3 * static_cast<size_t>(w) * h, 0) {}
  uint8_t* at(int x, int y) { return rgb.data() + 3 * (static_cast<size_t>(y) * width + x); }
  const uint8_t* at(int x, int y) const { return rgb.data() + 3 * (static_cast<size_t>(y) * width + x); }
};

enum class ColliderLook { kSolid, kGhost, kHidden };

// World space, a box with lower <= upper.
struct Box {
  Vec3d lower{0, 0, 0}, upper{0, 0, 0};
};

struct PictureSettings {
  int width = 640, height = 480;
  int samples = 16;            // rays a pixel on edges; inside, light and shade are gathered with a quarter of them and smoothed
  Vec3d view{0.62, 0.42, 1};   // from what is looked at towards the camera, any length
  Vec3d up{0, 1, 0};           // must not be parallel to `view`
  double zoom = 1;             // 2: half as wide
  Box frame;                   // what fills the picture at zoom 1, but for its very corners; fixed over a sequence, so that nothing jumps
  std::optional<Vec3d> focus;  // what is in the middle; the frame's centre when unset
  ColliderLook colliders = ColliderLook::kSolid;
  bool ground = true;           // a floor that shows shadows and hides nothing
  std::optional<double> floor;  // its height, world units along `up`; the frame's lowest corner when unset
  Colour skin{0.74f, 0.44f, 0.34f};
  Colour collider{0.36f, 0.42f, 0.50f};
  // With values: the body is coloured by them from range_low to range_high, with a scale bar.
  double range_low = 0, range_high = 1;
  bool diverging = false;  // a ramp with a neutral middle
  std::string label;       // over the bar
  std::string caption;     // at the lower left
};

// A box for a whole sequence: the rest box of the body where `rest` stands, widened by room for the colliders that depends on their size alone, not
// on where they are this frame.
KNEAD_API Box frame_box(const Surface& rest, const std::vector<const Surface*>& colliders);

// How low the rest box of the body reaches, along `up`: where it would stand on a floor.
KNEAD_API double lowest_height(const Surface& rest, const Vec3d& up);

// Sets the scale bar to what the finite values span: even about 0 on a diverging ramp, from 0 when `from_zero`, and never empty.
KNEAD_API void fit_range(PictureSettings& settings, std::span<const float> values, bool from_zero);

// front, back, left, right, top, bottom or three_quarter, seen with `up` upwards (y up: the front faces +z; z up: -y). Empty when the name is none of
// these.
KNEAD_API std::optional<Vec3d> view_direction(const std::string& name, const Vec3d& up);

// `values` is empty or one per vertex of `body`. Throws Error(kInput) on sizes that do not fit or directions that span nothing. `progress` is called
// now and then, and may throw to cancel.
KNEAD_API Image render_picture(const Surface& body, std::span<const float> values, const std::vector<const Surface*>& colliders,
                               const PictureSettings& settings, Executor& executor, FunctionRef<void()> progress);

KNEAD_API std::vector<uint8_t> encode_png(const Image& image);
KNEAD_API Image read_png(const std::string& path);
KNEAD_API void write_png(const std::string& path, const Image& image);  // whole or not at all; makes the folder

// All pictures in one, row by row, each reduced to at most 320 pixels wide and captioned with the number in its file's name. Pictures that are
// missing leave their place empty; throws when none can be read.
KNEAD_API void write_contact_sheet(const std::string& path, const std::vector<std::string>& picture_paths, int columns);

}  // namespace knead
