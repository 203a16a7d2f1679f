#include "io/picture/picture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>

#include "graph/error.h"
#include "io/picture/scene.h"
#include "io/picture/text.h"
#include "kernels/motion.h"
#include "kernels/shapes/primitives.h"

namespace knead::picture_test {
namespace {

Image pictured(const Surface& body, const std::vector<const Surface*>& colliders, PictureSettings settings, int threads = 2,
               std::span<const float> values = {}) {
  settings.width = std::min(settings.width, 160);
  settings.height = std::min(settings.height, 120);
  const auto executor = make_cpu_executor(threads);
  return render_picture(body, values, colliders, settings, *executor, [] {});
}

PictureSettings framing(const Surface& body) {
  PictureSettings settings;
  settings.frame = frame_box(body, {});
  settings.view = {0, 0, 1};
  settings.ground = false;
  return settings;
}

double luminance(const Image& image, int x, int y) {
  return 0.3 * image.at(x, y)[0] + 0.6 * image.at(x, y)[1] + 0.1 * image.at(x, y)[2];
}
bool reddish(const Image& image, int x, int y) {
  return image.at(x, y)[0] > image.at(x, y)[2] + 20;
}

// The share of pixels that differ by more than `step` in a channel.
double difference(const Image& a, const Image& b, int step) {
  size_t differing = 0;
  for (size_t i = 0; i < a.rgb.size(); i += 3) {
    int most = 0;
    for (size_t c = 0; c < 3; ++c) most = std::max(most, std::abs(a.rgb[i + c] - b.rgb[i + c]));
    differing += most > step;
  }
  return 3.0 * static_cast<double>(differing) / static_cast<double>(a.rgb.size());
}

std::string scratch(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "knead_picture_test";
  std::filesystem::create_directories(folder);
  return (folder / name).string();
}

TEST(Picture, ShowsTheBodyInTheMiddleAndTheBackgroundAround) {
  const Surface ball = make_sphere(1, 4);
  const Image image = pictured(ball, {}, framing(ball));
  EXPECT_TRUE(reddish(image, 80, 60));
  EXPECT_FALSE(reddish(image, 3, 3));
  EXPECT_FALSE(reddish(image, 156, 116));
  int covered = 0;
  for (int x = 0; x < 160; ++x) covered += reddish(image, x, 60);
  EXPECT_GT(covered, 70);  // it fills most of the height, which is 120
  EXPECT_LT(covered, 120);
}

TEST(Picture, IsTheSameBytesForAnyNumberOfThreadsAndAgain) {
  const Surface head = make_head(2, 1500), fist = posed(make_fist(1, 800), {.translate = {0.3, 0.2, 0.8}});
  PictureSettings settings = framing(head);
  settings.ground = true;
  const Image one = pictured(head, {&fist}, settings, 1);
  EXPECT_EQ(one.rgb, pictured(head, {&fist}, settings, 2).rgb);
  EXPECT_EQ(encode_png(one), encode_png(one));
}

TEST(Picture, DoesNotChangeWithTheUnitOrThePlaceOfTheScene) {
  const Surface head = make_head(2, 1200);
  const Image here = pictured(head, {}, framing(head));
  const Surface tiny = posed(head, {.scale = {1e-4, 1e-4, 1e-4}}), far = posed(head, {.translate = {1e6, -1e6, 1e6}});
  EXPECT_LT(difference(here, pictured(tiny, {}, framing(tiny)), 6), 0.01);
  EXPECT_LT(difference(here, pictured(far, {}, framing(far)), 6), 0.01);
}

TEST(Picture, HasNoAcneOnASmoothBall) {
  const Surface ball = make_sphere(1, 3);
  const Image image = pictured(ball, {}, framing(ball));
  // Along the middle row the brightness rises to one top and falls again, but for a step of rounding and of the smoothed noise.
  int turns = 0;
  double top = 0, low = 255;
  bool falling = false;
  for (int x = 40; x < 120; ++x) {
    const double v = luminance(image, x, 60);
    if (!falling) top = std::max(top, v);
    if (!falling && v < top - 8) falling = true, low = v;
    if (falling) {
      low = std::min(low, v);
      if (v > low + 8) ++turns, low = v;
    }
  }
  EXPECT_EQ(turns, 0);
}

TEST(Picture, ShadesTheInsideOfAnInsideOutMeshWithoutBlack) {
  const Surface ball = make_sphere(1, 3);
  std::vector<uint32_t> reversed = ball.topology->triangles;
  for (size_t t = 0; t < reversed.size(); t += 3) std::swap(reversed[t], reversed[t + 1]);
  const auto points = ball.points.host();
  const Surface inverted = make_triangle_surface({points.begin(), points.end()}, reversed);
  EXPECT_LT(difference(pictured(ball, {}, framing(ball)), pictured(inverted, {}, framing(ball)), 8), 0.02);
}

TEST(Picture, LeavesOutWhatIsNotFinite) {
  const Surface ball = make_sphere(1, 3);
  std::vector<Vec3f> points(ball.points.host().begin(), ball.points.host().end());
  points[3].x = std::numeric_limits<float>::quiet_NaN();
  points[9].y = std::numeric_limits<float>::infinity();
  const Surface broken = make_triangle_surface(points, ball.topology->triangles);
  const std::vector<float> values(points.size(), std::numeric_limits<float>::quiet_NaN());
  EXPECT_LT(difference(pictured(ball, {}, framing(ball)), pictured(broken, {}, framing(ball)), 30), 0.15);
  EXPECT_NO_THROW(pictured(broken, {}, framing(ball), 2, values));
}

TEST(Picture, CollidersAreSolidGhostOrHidden) {
  const Surface ball = make_sphere(1, 4), front = posed(make_sphere(0.5, 3), {.translate = {0, 0, 1.2}});
  PictureSettings settings = framing(ball);
  const Image bare = pictured(ball, {}, settings);
  settings.colliders = ColliderLook::kHidden;
  EXPECT_EQ(pictured(ball, {&front}, settings).rgb, bare.rgb);
  settings.colliders = ColliderLook::kSolid;
  EXPECT_FALSE(reddish(pictured(ball, {&front}, settings), 80, 60));
  settings.colliders = ColliderLook::kGhost;
  const Image ghost = pictured(ball, {&front}, settings);
  EXPECT_TRUE(reddish(ghost, 80, 60));  // the body shows through
  EXPECT_NE(ghost.rgb, bare.rgb);
}

TEST(Picture, AColliderAboveCastsAShadow) {
  const Surface plate = make_box({4, 0.2, 4}, 8), ball = posed(make_sphere(0.5, 3), {.translate = {-0.3, 0.7, 0}});
  PictureSettings settings = framing(plate);
  settings.view = {0.0, 1, 1};
  const Image lit = pictured(plate, {}, settings), shaded = pictured(plate, {&ball}, settings);
  int darker = 0;
  for (int y = 0; y < 120; ++y)
    for (int x = 0; x < 160; ++x) darker += reddish(lit, x, y) && reddish(shaded, x, y) && luminance(shaded, x, y) < 0.8 * luminance(lit, x, y);
  EXPECT_GT(darker, 50);
}

TEST(Picture, ColoursByValuesAndShowsTheirScale) {
  const Surface ball = make_sphere(1, 4);
  std::vector<float> values;
  for (const Vec3f& p : ball.points.host()) values.push_back(p.x);
  PictureSettings settings = framing(ball);
  settings.diverging = true;
  fit_range(settings, values, false);
  EXPECT_NEAR(settings.range_high, 1, 1e-3);
  EXPECT_EQ(settings.range_low, -settings.range_high);
  const Image image = pictured(ball, {}, settings, 2, values);
  EXPECT_GT(image.at(45, 60)[2], image.at(45, 60)[0]);    // blue on the left
  EXPECT_GT(image.at(112, 60)[0], image.at(112, 60)[2]);  // red on the right
  EXPECT_NE(image.rgb, pictured(ball, {}, settings).rgb);
}

TEST(Picture, FrameDoesNotDependOnWhereCollidersAre) {
  const Surface head = make_head(2, 600), fist = make_fist(1, 600),
                moved = posed(fist, {.translate = {0, 0, 5}, .rotate = rotation_xyz({10, 20, 30})});
  const Box a = frame_box(head, {&fist}), b = frame_box(head, {&moved});
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(a.lower[k], b.lower[k]);
    EXPECT_EQ(a.upper[k], b.upper[k]);
    EXPECT_LT(a.lower[k], head.lower[k]);
  }
}

TEST(Picture, ViewsFollowWhatIsUp) {
  EXPECT_EQ(view_direction("front", {0, 1, 0})->z, 1);
  EXPECT_EQ(view_direction("front", {0, 0, 1})->y, -1);
  EXPECT_GT(view_direction("top", {0, 0, 1})->z, 0.9);
  EXPECT_FALSE(view_direction("sideways", {0, 1, 0}));
}

TEST(Picture, RefusesWhatCannotBeDrawn) {
  const Surface ball = make_sphere(1, 1);
  PictureSettings settings = framing(ball);
  settings.view = settings.up;
  EXPECT_THROW(pictured(ball, {}, settings), Error);
  settings = framing(ball);
  settings.samples = 0;
  EXPECT_THROW(pictured(ball, {}, settings), Error);
  settings = framing(ball);
  settings.height = 4;
  EXPECT_THROW(pictured(ball, {}, settings), Error);
  const std::vector<float> few(3, 0.0f);
  EXPECT_THROW(pictured(ball, {}, framing(ball), 1, few), Error);
  settings = framing(ball);
  settings.frame.lower.x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(pictured(ball, {}, settings), Error);
}

TEST(Picture, RefusesMorePixelsThanMemoryAllows) {
  const Surface ball = make_sphere(1, 1);
  PictureSettings settings = framing(ball);
  settings.width = settings.height = 8000;
  const auto executor = make_serial_executor();
  EXPECT_THROW(render_picture(ball, {}, {}, settings, *executor, [] {}), Error);
}

TEST(Picture, StopsWhenAskedTo) {
  const Surface ball = make_sphere(1, 2);
  const auto executor = make_serial_executor();
  PictureSettings settings = framing(ball);
  settings.width = settings.height = 32;
  EXPECT_THROW(render_picture(ball, {}, {}, settings, *executor, [] { throw Error(ErrorCode::kCancelled, "stop"); }), Error);
}

TEST(FitRange, IsNeverEmptyAndSkipsWhatIsNotFinite) {
  PictureSettings settings;
  fit_range(settings, std::vector<float>{}, true);
  EXPECT_LT(settings.range_low, settings.range_high);
  fit_range(settings, std::vector<float>{0.5f, INFINITY, 0.25f, NAN}, true);
  EXPECT_EQ(settings.range_low, 0);
  EXPECT_EQ(settings.range_high, 0.5);
  fit_range(settings, std::vector<float>{3, 3}, false);
  EXPECT_LT(settings.range_low, settings.range_high);
}

TEST(RenderScene, CreasesSharpEdgesAndSmoothsRoundOnes) {
  const Surface cube = make_box({1, 1, 1}, 1), ball = make_sphere(1, 3);
  for (const Vec3f& n : smooth_corner_normals(cube.points.host(), cube.topology->triangles, 40))
    EXPECT_NEAR(std::max({std::abs(n.x), std::abs(n.y), std::abs(n.z)}), 1, 1e-6);
  const std::vector<Vec3f> normals = smooth_corner_normals(ball.points.host(), ball.topology->triangles, 60);
  for (size_t c = 0; c < normals.size(); ++c) EXPECT_GT(dot(normals[c], ball.points.host()[ball.topology->triangles[c]]), 0.999f);
}

TEST(RenderScene, SmoothsOverVerticesThatStandInOnePlace) {
  const Surface ball = make_sphere(1, 3);
  std::vector<Vec3f> soup;
  std::vector<uint32_t> triangles;
  for (uint32_t v : ball.topology->triangles) {
    triangles.push_back(static_cast<uint32_t>(soup.size()));
    soup.push_back(ball.points.host()[v]);
  }
  const std::vector<Vec3f> normals = smooth_corner_normals(soup, triangles, 60);
  for (size_t c = 0; c < normals.size(); ++c) EXPECT_GT(dot(normals[c], soup[c]), 0.999f);
}

TEST(RenderScene, FindsTheNearestHitAndWhatBlocks) {
  RenderScene scene;
  RenderMesh square{{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}}, {0, 1, 2, 0, 2, 3}, {}, {0, 1, 1, 0}};
  square.corner_normals = smooth_corner_normals(square.points, square.triangles, 60);
  scene.add(square);
  scene.commit();
  const RenderHit hit = scene.first_hit({0.5f, 0, 3}, {0, 0, -1});
  EXPECT_EQ(hit.mesh, 0);
  EXPECT_FLOAT_EQ(hit.distance, 3);
  EXPECT_NEAR(hit.value, 0.75, 1e-6);
  EXPECT_FLOAT_EQ(hit.normal.z, 1);
  EXPECT_FLOAT_EQ(scene.first_hit({0.5f, 0, -3}, {0, 0, 1}).normal.z, -1);
  EXPECT_EQ(scene.first_hit({5, 0, 3}, {0, 0, -1}).mesh, -1);
  const Vec3f directions[3] = {{0, 0, -1}, {0, 0, 1}, {1, 0, 0}};
  EXPECT_EQ(scene.blocked({0, 0, 1}, directions, 3, 10), 1u);
  EXPECT_EQ(scene.blocked({0, 0, 1}, directions, 3, 0.5f), 0u);
}

TEST(PictureText, RampsRiseInLightness) {
  const auto light = [](const Colour& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; };
  for (int i = 0; i < 20; ++i) EXPECT_LT(light(sequential_ramp(i / 20.0)), light(sequential_ramp((i + 1) / 20.0)));
  for (int i = 0; i < 10; ++i) EXPECT_LT(light(diverging_ramp(i / 20.0)), light(diverging_ramp((i + 1) / 20.0)));
  EXPECT_GT(diverging_ramp(1).r, diverging_ramp(1).b);
  EXPECT_LT(diverging_ramp(0).r, diverging_ramp(0).b);
}

TEST(PictureText, WritesShortNumbersAndStaysInThePicture) {
  EXPECT_EQ(short_number(0.0125), "0.0125");
  EXPECT_EQ(short_number(-0.0), "0");
  EXPECT_EQ(short_number(1.234e-5), "1.23e-05");
  Image image(20, 10);
  draw_text(image, -7, -3, "Outside?", 2, {1, 1, 1});
  draw_text(image, 15, 8, "Outside", 3, {1, 1, 1});
  EXPECT_GT(std::count(image.rgb.begin(), image.rgb.end(), uint8_t{255}), 0);
}

TEST(Png, SurvivesTheRoundTrip) {
  Image image(37, 21);
  for (size_t i = 0; i < image.rgb.size(); ++i) image.rgb[i] = static_cast<uint8_t>(i * 7);
  write_png(scratch("round.png"), image);
  const Image back = read_png(scratch("round.png"));
  EXPECT_EQ(back.width, 37);
  EXPECT_EQ(back.height, 21);
  EXPECT_EQ(back.rgb, image.rgb);
}

TEST(Png, RefusesWhatIsNone) {
  std::ofstream(scratch("garbage.png")) << "no picture";
  EXPECT_THROW(read_png(scratch("garbage.png")), Error);
  EXPECT_THROW(read_png(scratch("missing.png")), Error);
  Image image(40, 40);
  const std::vector<uint8_t> bytes = encode_png(image);
  std::ofstream(scratch("cut.png"), std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), static_cast<long>(bytes.size() / 2));
  EXPECT_THROW(read_png(scratch("cut.png")), Error);
}

TEST(ContactSheet, PutsPicturesInRowsAndLeavesMissingOnesEmpty) {
  std::vector<std::string> paths;
  for (int i = 1; i <= 5; ++i) {
    paths.push_back(scratch("shot.000" + std::to_string(i) + ".png"));
    Image image(64, 48);
    std::fill(image.rgb.begin(), image.rgb.end(), static_cast<uint8_t>(50 * i));
    if (i != 4) write_png(paths.back(), image);
  }
  write_contact_sheet(scratch("sheet.png"), paths, 3);
  const Image sheet = read_png(scratch("sheet.png"));
  EXPECT_EQ(sheet.width, 3 * 64 + 4 * 4);
  EXPECT_EQ(sheet.height, 2 * 48 + 3 * 4);
  EXPECT_EQ(sheet.at(40, 20)[0], 50);
  EXPECT_EQ(sheet.at(4 + 68 + 40, 20)[1], 100);
  EXPECT_EQ(sheet.at(40, 4 + 52 + 10)[2], 40);            // the fourth is missing
  EXPECT_EQ(sheet.at(4 + 68 + 40, 4 + 52 + 10)[2], 250);  // the fifth
  EXPECT_THROW(write_contact_sheet(scratch("none.png"), {scratch("nowhere.png")}, 3), Error);
  EXPECT_THROW(write_contact_sheet(scratch("none.png"), {}, 3), Error);
}

TEST(ContactSheet, ReducesLargePictures) {
  Image image(1000, 500);
  std::fill(image.rgb.begin(), image.rgb.end(), uint8_t{77});
  write_png(scratch("large.7.png"), image);
  write_contact_sheet(scratch("small.png"), {scratch("large.7.png")}, 4);
  const Image sheet = read_png(scratch("small.png"));
  EXPECT_EQ(sheet.width, 320 + 8);
  EXPECT_EQ(sheet.height, 160 + 8);
  EXPECT_EQ(sheet.at(200, 50)[1], 77);
}

}  // namespace
}  // namespace knead::picture_test
