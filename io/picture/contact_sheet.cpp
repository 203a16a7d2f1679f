#include <png.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>

#include "io/files.h"
#include "io/picture/picture.h"
#include "io/picture/text.h"

namespace knead {

namespace {

constexpr int kWidestThumbnail = 320;
constexpr png_uint_32 kWidestPicture = 1u << 15;

// Every pixel of the result is the mean of what it covers.
Image reduced(const Image& from, int width, int height) {
  Image to(width, height);
  const double sx = static_cast<double>(from.width) / width, sy = static_cast<double>(from.height) / height;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      double sum[3] = {0, 0, 0}, weight = 0;
      const double x0 = x * sx, x1 = (x + 1) * sx, y0 = y * sy, y1 = (y + 1) * sy;
      for (int v = static_cast<int>(y0); v < std::min(from.height, static_cast<int>(std::ceil(y1))); ++v)
        for (int u = static_cast<int>(x0); u < std::min(from.width, static_cast<int>(std::ceil(x1))); ++u) {
          const double share =
              (std::min(x1, u + 1.0) - std::max(x0, static_cast<double>(u))) * (std::min(y1, v + 1.0) - std::max(y0, static_cast<double>(v)));
          for (int c = 0; c < 3; ++c) sum[c] += share * from.at(u, v)[c];
          weight += share;
        }
      for (int c = 0; c < 3; ++c) to.at(x, y)[c] = static_cast<uint8_t>(std::lround(sum[c] / weight));
    }
  return to;
}

// The last run of digits in the file's name without its zeros ahead, or the name.
std::string caption_of(const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  size_t end = stem.size();
  while (end > 0 && !digit(stem[end - 1])) --end;
  size_t begin = end;
  while (begin > 0 && digit(stem[begin - 1])) --begin;
  if (begin == end) return stem;
  while (begin + 1 < end && stem[begin] == '0') ++begin;
  return stem.substr(begin, end - begin);
}

}  // namespace

std::vector<uint8_t> encode_png(const Image& image) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.width);
  png.height = static_cast<png_uint_32>(image.height);
  png.format = PNG_FORMAT_RGB;
  png.flags = PNG_IMAGE_FLAG_FAST;  // a third of the time for a tenth more bytes
  std::vector<uint8_t> bytes(PNG_IMAGE_PNG_SIZE_MAX(png));
  png_alloc_size_t size = bytes.size();
  if (!png_image_write_to_memory(&png, bytes.data(), &size, 0, image.rgb.data(), 0, nullptr))
    throw Error(ErrorCode::kInternal, std::string("the picture cannot be packed: ") + png.message);
  bytes.resize(size);
  return bytes;
}

void write_png(const std::string& path, const Image& image) {
  const std::vector<uint8_t> bytes = encode_png(image);
  write_whole_file(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

Image read_png(const std::string& path) {
  const std::string bytes = read_whole_file(path);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  const auto refuse = [&](const std::string& why) {
    png_image_free(&png);
    throw Error(ErrorCode::kFile, in_file(path), "not a readable PNG picture: " + why, "make it again");
  };
  if (!png_image_begin_read_from_memory(&png, bytes.data(), bytes.size())) refuse(png.message);
  if (png.width > kWidestPicture || png.height > kWidestPicture) refuse("it is larger than 32768 pixels");
  png.format = PNG_FORMAT_RGB;
  Image image(static_cast<int>(png.width), static_cast<int>(png.height));
  const png_color behind{255, 255, 255};
  if (!png_image_finish_read(&png, &behind, image.rgb.data(), 0, nullptr)) refuse(png.message);
  return image;
}

void write_contact_sheet(const std::string& path, const std::vector<std::string>& picture_paths, int columns) {
  if (columns < 1 || picture_paths.empty()) throw Error(ErrorCode::kInput, "a contact sheet needs pictures and at least one column");
  std::vector<Image> pictures;  // reduced, or empty when missing
  int width = 0, height = 0;
  std::string first_problem;
  for (const std::string& name : picture_paths) {
    pictures.emplace_back();
    try {
      const Image whole = read_png(name);
      if (width == 0) {
        width = std::min(whole.width, kWidestThumbnail);
        height = std::max(1, static_cast<int>(std::lround(static_cast<double>(whole.height) * width / whole.width)));
      }
      pictures.back() = reduced(whole, width, height);
    } catch (const Error& error) {
      if (first_problem.empty()) first_problem = error.what();
    }
  }
  if (width == 0)
    throw Error(ErrorCode::kFile, in_file(path), "a contact sheet of pictures of which none can be read: " + first_problem, "make them first");

  columns = std::min(columns, static_cast<int>(pictures.size()));
  const int rows = (static_cast<int>(pictures.size()) + columns - 1) / columns, gap = 4;
  Image sheet(columns * (width + gap) + gap, rows * (height + gap) + gap);
  std::fill(sheet.rgb.begin(), sheet.rgb.end(), uint8_t{40});
  for (size_t i = 0; i < pictures.size(); ++i) {
    const int left = gap + static_cast<int>(i) % columns * (width + gap), top = gap + static_cast<int>(i) / columns * (height + gap);
    for (int y = 0; y < height && pictures[i].width > 0; ++y) std::copy_n(pictures[i].at(0, y), 3 * width, sheet.at(left, top + y));
    const Colour ink = pictures[i].width > 0 ? Colour{0.05f, 0.055f, 0.06f} : Colour{0.4f, 0.4f, 0.4f};
    const int size = width >= 160 ? 2 : 1;
    draw_text(sheet, left + 3 * size, top + height - text_height(size) - 3 * size, caption_of(picture_paths[i]), size, ink);
  }
  write_png(path, sheet);
}

}  // namespace knead
