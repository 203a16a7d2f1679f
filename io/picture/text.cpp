#include "io/picture/text.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace knead {

namespace {

struct Glyph {
  char sign;
  std::array<uint8_t, 7> rows;  // bit 4 is the left column
};

constexpr Glyph kGlyphs[] = {
    {'0', {14, 17, 19, 21, 25, 17, 14}}, {'1', {4, 12, 4, 4, 4, 4, 14}},      {'2', {14, 17, 1, 6, 8, 16, 31}},
    {'3', {14, 17, 1, 6, 1, 17, 14}},    {'4', {2, 6, 10, 18, 31, 2, 2}},     {'5', {31, 16, 30, 1, 1, 17, 14}},
    {'6', {6, 8, 16, 30, 17, 17, 14}},   {'7', {31, 1, 2, 4, 4, 8, 8}},       {'8', {14, 17, 17, 14, 17, 17, 14}},
    {'9', {14, 17, 17, 15, 1, 2, 12}},   {'A', {14, 17, 17, 31, 17, 17, 17}}, {'B', {30, 17, 17, 30, 17, 17, 30}},
    {'C', {14, 17, 16, 16, 16, 17, 14}}, {'D', {30, 17, 17, 17, 17, 17, 30}}, {'E', {31, 16, 16, 30, 16, 16, 31}},
    {'F', {31, 16, 16, 30, 16, 16, 16}}, {'G', {14, 17, 16, 23, 17, 17, 15}}, {'H', {17, 17, 17, 31, 17, 17, 17}},
    {'I', {14, 4, 4, 4, 4, 4, 14}},      {'J', {1, 1, 1, 1, 1, 17, 14}},      {'K', {17, 18, 20, 24, 20, 18, 17}},
    {'L', {16, 16, 16, 16, 16, 16, 31}}, {'M', {17, 27, 21, 21, 17, 17, 17}}, {'N', {17, 25, 21, 21, 19, 17, 17}},
    {'O', {14, 17, 17, 17, 17, 17, 14}}, {'P', {30, 17, 17, 30, 16, 16, 16}}, {'Q', {14, 17, 17, 17, 21, 18, 13}},
    {'R', {30, 17, 17, 30, 20, 18, 17}}, {'S', {15, 16, 16, 14, 1, 1, 30}},   {'T', {31, 4, 4, 4, 4, 4, 4}},
    {'U', {17, 17, 17, 17, 17, 17, 14}}, {'V', {17, 17, 17, 17, 10, 10, 4}},  {'W', {17, 17, 17, 21, 21, 27, 17}},
    {'X', {17, 10, 10, 4, 10, 10, 17}},  {'Y', {17, 17, 10, 4, 4, 4, 4}},     {'Z', {31, 1, 2, 4, 8, 16, 31}},
    {'.', {0, 0, 0, 0, 0, 12, 12}},      {',', {0, 0, 0, 0, 12, 4, 8}},       {':', {0, 12, 12, 0, 12, 12, 0}},
    {';', {0, 12, 12, 0, 12, 4, 8}},     {'-', {0, 0, 0, 14, 0, 0, 0}},       {'+', {0, 4, 4, 31, 4, 4, 0}},
    {'/', {1, 1, 2, 4, 8, 16, 16}},      {'%', {24, 25, 2, 4, 8, 19, 3}},     {'(', {2, 4, 8, 8, 8, 4, 2}},
    {')', {8, 4, 2, 2, 2, 4, 8}},        {'=', {0, 0, 31, 0, 31, 0, 0}},      {'_', {0, 0, 0, 0, 0, 0, 31}},
    {'#', {10, 10, 31, 10, 31, 10, 10}}, {'\'', {4, 4, 8, 0, 0, 0, 0}},       {' ', {0, 0, 0, 0, 0, 0, 0}},
};
constexpr std::array<uint8_t, 7> kUnknown = {31, 17, 17, 17, 17, 17, 31};
constexpr int kAdvance = 6, kRows = 7;

const std::array<uint8_t, 7>& rows_of(char sign) {
  const char capital = static_cast<char>(std::toupper(static_cast<unsigned char>(sign)));
  for (const Glyph& glyph : kGlyphs)
    if (glyph.sign == capital) return glyph.rows;
  return kUnknown;
}

uint8_t to_srgb(float linear) {
  const double v = std::clamp(static_cast<double>(linear), 0.0, 1.0);
  return static_cast<uint8_t>(std::lround(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055)));
}

void put(Image& image, int x, int y, const Colour& colour) {
  if (x < 0 || y < 0 || x >= image.width || y >= image.height) return;
  uint8_t* p = image.at(x, y);
  p[0] = to_srgb(colour.r);
  p[1] = to_srgb(colour.g);
  p[2] = to_srgb(colour.b);
}

// OKLab to linear sRGB, by lightness, chroma and hue in degrees.
Colour from_oklch(double lightness, double chroma, double hue) {
  const double a = chroma * std::cos(hue * std::numbers::pi / 180), b = chroma * std::sin(hue * std::numbers::pi / 180);
  const double l = std::pow(lightness + 0.3963377774 * a + 0.2158037573 * b, 3);
  const double m = std::pow(lightness - 0.1055613458 * a - 0.0638541728 * b, 3);
  const double s = std::pow(lightness - 0.0894841775 * a - 1.2914855480 * b, 3);
  const auto in_range = [](double v) { return static_cast<float>(std::clamp(v, 0.0, 1.0)); };
  return {in_range(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s), in_range(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
          in_range(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s)};
}

}  // namespace

int text_width(const std::string& text, int size) {
  return text.empty() ? 0 : (static_cast<int>(text.size()) * kAdvance - 1) * size;
}

int text_height(int size) {
  return kRows * size;
}

void draw_text(Image& image, int left, int top, const std::string& text, int size, const Colour& ink) {
  for (size_t i = 0; i < text.size(); ++i) {
    const auto& rows = rows_of(text[i]);
    for (int y = 0; y < kRows * size; ++y)
      for (int x = 0; x < 5 * size; ++x)
        if (rows[y / size] >> (4 - x / size) & 1) put(image, left + static_cast<int>(i) * kAdvance * size + x, top + y, ink);
  }
}

Colour sequential_ramp(double t) {
  t = std::clamp(t, 0.0, 1.0);
  return from_oklch(0.36 + 0.55 * t, 0.125 + 0.045 * t, 300 - 195 * t);
}

Colour diverging_ramp(double t) {
  const double side = 2 * std::clamp(t, 0.0, 1.0) - 1, far = std::abs(side);
  return from_oklch(0.90 - 0.45 * far, 0.17 * far, side < 0 ? 255 : 28);
}

std::string short_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value == 0 ? 0.0 : value);  // no minus before zero
  return text;
}

void draw_scale_bar(Image& image, double low, double high, bool diverging, const std::string& label) {
  const int size = std::max(1, image.height / 320), thick = 12 * size;
  const int long_side = image.height / 2, top = (image.height - long_side) / 2;
  const int right = image.width - 8 * size, left = right - thick;
  const Colour ink{0.05f, 0.055f, 0.06f};
  for (int y = -size; y < long_side + size; ++y)
    for (int x = left - size; x < right + size; ++x) {
      const bool edge = y < 0 || y >= long_side || x < left || x >= right;
      const double t = 1 - (y + 0.5) / long_side;
      put(image, x, top + y, edge ? ink : diverging ? diverging_ramp(t) : sequential_ramp(t));
    }
  for (int tick = 0; tick <= 4; ++tick) {
    const int y = top + static_cast<int>(std::lround((long_side - 1) * (1 - tick / 4.0)));
    for (int x = 1; x <= 4 * size; ++x)
      for (int k = 0; k < size; ++k) put(image, left - size - x, y + k - size / 2, ink);
    const std::string number = short_number(low + (high - low) * tick / 4);
    draw_text(image, left - 7 * size - text_width(number, size), y - text_height(size) / 2, number, size, ink);
  }
  draw_text(image, std::max(2 * size, right - text_width(label, size)), top - text_height(size) - 8 * size, label, size, ink);
}

}  // namespace knead
