// What is drawn over a picture: numbers and words in a small bitmap font, colour ramps and their scale bar.
#pragma once
#include <string>

#include "io/picture/picture.h"

namespace knead {

// Capitals, digits and . , : ; - + / % ( ) = _ # ' in a 5 x 7 font, small letters as capitals, anything else as a box; `size` pixels per dot.
int text_width(const std::string& text, int size);
int text_height(int size);
void draw_text(Image& image, int left, int top, const std::string& text, int size, const Colour& ink);

// `t` from 0 to 1, clamped; sRGB-linear out. Sequential ramps rise evenly in OKLab lightness from indigo through green to yellow; diverging ones run
// from blue through a light grey at 0.5 to red, even on both sides (B. Ottosson 2020, "A perceptual color space for image processing").
Colour sequential_ramp(double t);
Colour diverging_ramp(double t);

// A vertical bar with `low`, the middle and `high` written beside it, at the right edge, and `label` over it.
void draw_scale_bar(Image& image, double low, double high, bool diverging, const std::string& label);

std::string short_number(double value);  // at most 7 characters: 0.0125, 1.2e-05, 340

}  // namespace knead
