// Light directions drawn by a warp of the unit square, and their density, for the OSL shaders; and by either sampler.

#ifndef MEASURED_WARPS_H
#define MEASURED_WARPS_H

#include "measured_cells.h"

color mm_warp_texel(MMSampler sampler, float bin, float column, output float alpha)
{
  int width = sampler.strata + sampler.cell_rows * sampler.cell_columns;
  int bins = sampler.bins * max(sampler.bins_phi, 1);
  return mm_tap(sampler.image, (column + 0.5) / width, (bin + 0.5) / bins, "closest", alpha);
}

// What every draw and density of one viewer needs: its bin and, of a warp, the share of matte draws there.
struct MMViewer {
  float bin;
  float matte;
};

MMViewer mm_viewer_of(MMSampler sampler, vector wo)
{
  MMViewer viewer = {mm_viewer_bin(sampler, wo), 0};
  if (sampler.strata > 0)
    color first = mm_warp_texel(sampler, viewer.bin, 0, viewer.matte);
  return viewer;
}

// bake/sampling/inverse_tables.py: inverted
float mm_inverted(float u, color entry)
{
  float cell = floor(entry[0]);
  float beyond = u - (entry[0] - cell);
  return cell + beyond * (beyond > 0 ? entry[2] : entry[1]);
}

// HalfVectorWarp.half_at
vector mm_polar_half_at(MMSampler sampler, float s, float t, float u)
{
  float m = min((exp(s * log(1 + 1 / sampler.linear)) - 1) * sampler.linear, 1.0);
  float sine = sqrt(m * (2 - m));
  float phi = t * M_PI;
  return vector(sine * cos(phi), sine * sin(phi) * (u > 0.5 ? 1 : -1), 1 - m);
}

// SlopeWarp.half_at
vector mm_slope_half_at(MMSampler sampler, vector wo, float s, float t)
{
  float side = mm_turned(sampler, wo);
  float x = side * mm_slope_unwarp(clamp(2 * t - 1, -MM_CELL_EDGE, MM_CELL_EDGE), sampler.width_x);
  float y = side * mm_slope_unwarp(clamp(2 * s - 1, -MM_CELL_EDGE, MM_CELL_EDGE), sampler.width_y);
  return normalize(vector(x, y, 1));
}

// bake/sampling/warp_sampler.py: draw
vector mm_warp_draw(MMSampler sampler, MMViewer viewer, vector wo, float u, float v)
{
  float bin = viewer.bin;
  float matte = viewer.matte;
  float unused;
  int is_matte = u < matte;
  float rest = is_matte ? u / matte : (u - matte) / (1 - matte);
  if (is_matte) {
    float radius = sqrt(rest);
    float angle = (2 * v - 1) * M_PI;
    return vector(radius * cos(angle), radius * sin(angle), sqrt(1 - rest));
  }
  float s = mm_inverted(rest, mm_warp_texel(sampler, bin, mm_index(rest, sampler.strata), unused));
  float row = min(floor(s), sampler.cell_rows - 1.0);
  float of_t = sampler.bins_phi == 0 ? abs(2 * v - 1) : v;
  float column = sampler.strata + row * sampler.cell_columns + mm_index(of_t, sampler.cell_columns);
  float t = mm_inverted(of_t, mm_warp_texel(sampler, bin, column, unused)) / sampler.cell_columns;
  s /= sampler.cell_rows;
  vector h = sampler.bins_phi == 0 ? mm_polar_half_at(sampler, s, t, v) : mm_slope_half_at(sampler, wo, s, t);
  return 2 * dot(wo, h) * h - wo;
}

// bake/sampling/warp_sampler.py: density
float mm_warp_density(MMSampler sampler, MMViewer viewer, vector wi, vector wo)
{
  MMHalf h;
  float s, t;
  float m = 0;
  float range = 1;
  if (sampler.bins_phi == 0) {
    h.direction = normalize(wi + wo);
    h.x = 0;
    h.y = 0;
    vector apart = h.direction - vector(0, 0, 1);
    m = dot(apart, apart) * 0.5;
    range = log(1 + 1 / sampler.linear);
    s = log(m / sampler.linear + 1) / range;
    t = abs(mm_arctan2(h.direction[1], h.direction[0])) / M_PI;
  }
  else {
    float along, across;
    mm_warped_slopes(sampler, wi, wo, h, along, across);
    s = 0.5 + 0.5 * across;
    t = 0.5 + 0.5 * along;
  }
  float row = mm_index(s, sampler.cell_rows);
  float column = sampler.strata + row * sampler.cell_columns + mm_index(t, sampler.cell_columns);
  float of_cell;
  color entry = mm_warp_texel(sampler, viewer.bin, column, of_cell);
  float wo_half = dot(wo, h.direction);
  float of_half = 0;
  if (sampler.bins_phi == 0)
    of_half = of_cell / ((m + sampler.linear) * (8 * M_PI * range) * max(wo_half, 1e-6));
  else
    of_half = mm_cell_pdf(sampler, of_cell, h, wo_half);
  return of_half + viewer.matte * (max(wi[2], 0.0) / M_PI);
}

// Local wi and its density by the sampler's kind; a warp takes the first two of the numbers.
vector mm_draw(
    MMSampler sampler, MMViewer viewer, vector wo, float u1, float u2, float u3, float u4, output float pdf)
{
  if (sampler.strata == 0)
    return mm_alias_draw(sampler, viewer.bin, wo, u1, u2, u3, u4, pdf);
  vector wi = mm_warp_draw(sampler, viewer, wo, u1, u2);
  pdf = mm_warp_density(sampler, viewer, wi, wo);
  return wi;
}

// The density with which mm_draw gives wi.
float mm_density(MMSampler sampler, MMViewer viewer, vector wi, vector wo)
{
  if (sampler.strata == 0)
    return mm_alias_density(sampler, viewer.bin, wi, wo);
  return mm_warp_density(sampler, viewer, wi, wo);
}

// The same where a viewer asks but once.
vector mm_draw(MMSampler sampler, vector wo, float u1, float u2, float u3, float u4, output float pdf)
{
  return mm_draw(sampler, mm_viewer_of(sampler, wo), wo, u1, u2, u3, u4, pdf);
}

float mm_density(MMSampler sampler, vector wi, vector wo)
{
  return mm_density(sampler, mm_viewer_of(sampler, wo), wi, wo);
}

#endif
