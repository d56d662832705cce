// Arithmetic of the OSL shaders: angles, indices and texture taps. Each twin is named beside its function.
//
// OSL's quotient by 0 is 0, and its normalize() keeps the zero vector, as `xp.divide` and `xp.normalize` do. Its arcsine
// and arctangent are fast and wrong by up to 1e-4; the functions here correct them by a Newton step. Textures are read
// from files, by OSL's own texture system: untouched by colour management, row 0 on top, hence t = 0 there.

#ifndef MEASURED_MATH_H
#define MEASURED_MATH_H

float mm_arcsin(float x) // |x| <= sqrt(1/2)
{
  float a = asin(x);
  return a + (x - sin(a)) / cos(a);
}

float mm_arctan2(float y, float x)
{
  float a = atan2(y, x);
  return a + (y * cos(a) - x * sin(a)) / sqrt(x * x + y * y);
}

float mm_chord(vector a, vector b)
{
  return min(length(a - b) * M_SQRT1_2, 1.0);
}

// nodes/adjustments.py: saturation_group, exactly the colour itself at 1
color mm_saturated(color value, float saturation)
{
  if (saturation == 1)
    return value;
  float luminance = 0.2126 * value[0] + 0.7152 * value[1] + 0.0722 * value[2];
  return max(mix(color(luminance), value, max(saturation, 0.0)), color(0));
}

color mm_tap(string image, float s, float t, string interpolation, output float alpha)
{
  // Without derivatives no coarser mip level is ever read.
  return texture(image, s, t, 0.0, 0.0, 0.0, 0.0, "wrap", "clamp", "interp", interpolation, "alpha", alpha);
}

// bake/tables/log_codes.py: LogCodes.decode; a range of 0 says that these are values
color mm_decode(color code, vector range, vector gain)
{
  return range[0] > 0 ? color(gain) * (exp(color(range) * code) - 1) : code;
}

// Index in 0 to count - 1 of a position in [0, 1], both ends included.
float mm_index(float position, int count)
{
  return min(floor(position * count), count - 1.0);
}

// bake/tables/grids/anisotropic_grids.py: azimuth_index
float mm_azimuth_index(float x, float y, int n, int folded)
{
  float turns = mm_arctan2(y, x) * ((folded ? 1.0 : 0.5) / M_PI);
  return (turns < 0 ? turns + 1 : turns) * n;
}

// bake/tables/grids/anisotropic_grids.py: slope_warp and slope_unwarp
float mm_slope_warp(float x, float width)
{
  return x / (width + abs(x));
}

float mm_slope_unwarp(float u, float width)
{
  return width * u / (1 - abs(u));
}

#endif
