// Light directions drawn by alias tables over cells of half vectors, and their density, for the OSL shaders.

#ifndef MEASURED_CELLS_H
#define MEASURED_CELLS_H

#include "measured_math.h"

#define MM_CELL_EDGE 0.999999 // bake/sampling/slope_cells.py

// Alias tables of bake/sampling/half_vector_cells.py, whose cells are of the half vector's elevation and azimuth, `warp`
// the power of their edges, or of bake/sampling/slope_cells.py: with bins of the viewer's azimuth, `bins_phi`, else 0,
// and cells of the slopes across and along the tangent. With `strata` of the first random number, else 0, the image is a
// warp of bake/sampling/warp_sampler.py, `linear` the width of its elevations: measured_warps.h.
struct MMSampler {
  string image;
  int bins;
  int bins_phi;
  int cell_rows;
  int cell_columns;
  int warp;
  float width_x;
  float width_y;
  int half_turn;
  int strata;
  float linear;
};

// A half vector and, of cells of slopes, its own.
struct MMHalf {
  vector direction;
  float x;
  float y;
};

// viewer_bin
float mm_viewer_bin(MMSampler sampler, vector wo)
{
  float elevation = mm_index(mm_chord(wo, vector(0, 0, 1)), sampler.bins);
  if (sampler.bins_phi == 0)
    return elevation;
  float azimuth = floor(mm_azimuth_index(wo[0], wo[1], sampler.bins_phi, sampler.half_turn) + 0.5);
  if (azimuth > sampler.bins_phi - 0.5)
    azimuth = 0;
  return elevation * sampler.bins_phi + azimuth;
}

// turned
float mm_turned(MMSampler sampler, vector wo)
{
  if (!sampler.half_turn)
    return 1;
  float index = 2 * mm_azimuth_index(wo[0], wo[1], sampler.bins_phi, 0);
  return index > sampler.bins_phi - 0.5 && index < 2 * sampler.bins_phi - 0.5 ? -1 : 1;
}

color mm_sampler_texel(MMSampler sampler, float bin, float cell, output float alpha)
{
  int cells = sampler.cell_rows * sampler.cell_columns;
  int bins = sampler.bins * max(sampler.bins_phi, 1);
  return mm_tap(sampler.image, (cell + 0.5) / cells, (bin + 0.5) / bins, "closest", alpha);
}

float mm_cell_edge(MMSampler sampler, float index)
{
  float x = index / sampler.cell_rows;
  float edge = x * x;
  for (int k = 1; k < sampler.warp; ++k)
    edge *= x * x;
  return edge;
}

// The half vector at a place in a cell of elevation and azimuth.
MMHalf mm_polar_half(MMSampler sampler, float row, float column, float u, float v)
{
  float low = mm_cell_edge(sampler, row);
  float m = low + u * (mm_cell_edge(sampler, row + 1) - low);
  // One number serves side and place in the cell: the upper half of [0, 1] is one side, the lower the other.
  int side = v > 0.5;
  float phi = (column + (side ? 2 * v - 1 : 2 * v)) * (M_PI / sampler.cell_columns);
  float sine = sqrt(m * (2 - m));
  MMHalf h;
  h.direction = vector(sine * cos(phi), sine * sin(phi) * (side ? 1 : -1), 1 - m);
  h.x = 0;
  h.y = 0;
  return h;
}

// The half vector at a place in a cell of slopes.
MMHalf mm_slope_half(MMSampler sampler, vector wo, float row, float column, float u, float v)
{
  float side = mm_turned(sampler, wo);
  MMHalf h;
  h.x = side * mm_slope_unwarp(
      clamp((column + u) * (2.0 / sampler.cell_columns) - 1, -MM_CELL_EDGE, MM_CELL_EDGE), sampler.width_x);
  h.y = side * mm_slope_unwarp(
      clamp((row + v) * (2.0 / sampler.cell_rows) - 1, -MM_CELL_EDGE, MM_CELL_EDGE), sampler.width_y);
  h.direction = normalize(vector(h.x, h.y, 1));
  return h;
}

// Density of wi from what is stored of the half vector's cell: its density, or its probability times their number.
float mm_cell_pdf(MMSampler sampler, float stored, MMHalf h, float wo_half)
{
  if (sampler.bins_phi == 0)
    return stored / (4 * max(wo_half, 1e-6));
  float z = h.direction[2];
  float to_x = sampler.width_x + abs(h.x);
  float to_y = sampler.width_y + abs(h.y);
  float spread = to_x * to_x * to_y * to_y * (z * z * z) * max(wo_half, 1e-6);
  return stored * ((sampler.width_x * sampler.width_y / 16) / spread);
}

// reflect_from_cell; local wi and its density
vector mm_alias_draw(
    MMSampler sampler, float bin, vector wo, float u_cell, float u_alias, float u, float v, output float pdf)
{
  float cell = mm_index(u_cell, sampler.cell_rows * sampler.cell_columns);
  float alias_stored;
  color texel = mm_sampler_texel(sampler, bin, cell, alias_stored);
  int keep = u_alias < texel[0];
  float chosen = keep ? cell : texel[1];
  float row = floor((chosen + 0.5) / sampler.cell_columns);
  float column = chosen - row * sampler.cell_columns;
  MMHalf h;
  if (sampler.bins_phi == 0)
    h = mm_polar_half(sampler, row, column, u, v);
  else
    h = mm_slope_half(sampler, wo, row, column, u, v);
  float wo_half = dot(wo, h.direction);
  pdf = mm_cell_pdf(sampler, keep ? texel[2] : alias_stored, h, wo_half);
  return 2 * wo_half * h.direction - wo;
}

// find_texel: the cell of elevation and azimuth in which the half vector of two directions lies
float mm_polar_cell(MMSampler sampler, vector wi, vector wo, output MMHalf h)
{
  h.direction = normalize(wi + wo);
  h.x = 0;
  h.y = 0;
  vector apart = h.direction - vector(0, 0, 1);
  float m = dot(apart, apart) * 0.5;
  float column = mm_index(abs(mm_arctan2(h.direction[1], h.direction[0])) / M_PI, sampler.cell_columns);
  // The root by square roots where they serve: pow() is fast and wrong by 1e-5.
  float root = sqrt(m);
  if (sampler.warp == 2)
    root = sqrt(root);
  else if (sampler.warp != 1)
    root = pow(root, 1.0 / sampler.warp);
  return mm_index(root, sampler.cell_rows) * sampler.cell_columns + column;
}

// SlopeLayout.warped: the half vector, and its warped slopes in (-1, 1) as the viewer's bin has them
void mm_warped_slopes(MMSampler sampler, vector wi, vector wo, output MMHalf h, output float u, output float v)
{
  vector total = wi + wo;
  total[2] = max(total[2], 1e-6);
  h.direction = normalize(total);
  h.x = total[0] / total[2];
  h.y = total[1] / total[2];
  float side = mm_turned(sampler, wo);
  u = mm_slope_warp(side * h.x, sampler.width_x);
  v = mm_slope_warp(side * h.y, sampler.width_y);
}

// find_texel: the same of slopes
float mm_slope_cell(MMSampler sampler, vector wi, vector wo, output MMHalf h)
{
  float u;
  float v;
  mm_warped_slopes(sampler, wi, wo, h, u, v);
  float column = mm_index(0.5 + 0.5 * u, sampler.cell_columns);
  float row = mm_index(0.5 + 0.5 * v, sampler.cell_rows);
  return row * sampler.cell_columns + column;
}

// The density with which mm_alias_draw gives wi.
float mm_alias_density(MMSampler sampler, float bin, vector wi, vector wo)
{
  MMHalf h;
  float cell = 0;
  if (sampler.bins_phi == 0)
    cell = mm_polar_cell(sampler, wi, wo, h);
  else
    cell = mm_slope_cell(sampler, wi, wo, h);
  float alias_stored;
  color texel = mm_sampler_texel(sampler, bin, cell, alias_stored);
  return mm_cell_pdf(sampler, texel[2], h, dot(wo, h.direction));
}

#endif
