// Tables of BRDFs for the OSL shaders, isotropic or not: where samples lie, and values between them.

#ifndef MEASURED_TABLES_H
#define MEASURED_TABLES_H

#include "measured_math.h"

#define MM_GUTTER 2       // bake/tables/padding.py
#define MM_LEAST_SUM 1e-3 // bake/tables/grids/grid.py

// Where samples lie: the grids of bake/tables, two in each basis, and patches. Those of bake/tables/grids/anisotropic_grids.py have a
// second slice axis, `azimuths`; of an isotropic table it is 0. A shape is Bezier's alpha in [0], the constants of a
// LogWarp, or the width of an axis of slopes.
struct MMGrid {
  string basis;
  string parameterization;
  int azimuths;
  int slices;
  int slice_rows;
  int slice_columns;
  vector shape_slice;
  vector shape_row;
  vector shape_phi;
  int reciprocal;
  int folded;
};

// The samples: the atlas of bake/tables/atlas.py, `columns` slices side by side, and what its
// values are multiplied by, or their codes stand for. An artist's saturation is applied to all that is looked up.
struct MMTable {
  string image;
  float scale;
  float offset;
  vector log_range;
  vector log_gain;
  int columns;
  int rows;
  string filter;
  int stochastic;
  float saturation;
};

// bake/tables/grids/parameterization.py: forward
float mm_forward(string parameterization, float v, vector shape)
{
  float t = 1 - v;
  if (parameterization == "fitted")
    return 1 - log(1 + v * shape[0] / (shape[1] - v)) * shape[2];
  if (parameterization == "identity")
    return t * (1 + v);
  if (parameterization == "uniform")
    return 1 - (4 / M_PI) * mm_arcsin(v * M_SQRT1_2);
  if (parameterization == "squared")
    return 1 - sqrt((4 / M_PI) * mm_arcsin(v * M_SQRT1_2));
  return t * (2 * shape[0] + (1 - 2 * shape[0]) * t);
}

// bake/tables/grids/parameterization.py: normal_basis_coordinates, (u_o, u_i, u_phi)
vector mm_normal_coordinates(MMGrid grid, vector wi, vector wo)
{
  vector n = vector(0, 0, 1);
  float u_o = mm_forward(grid.parameterization, mm_chord(wo, n), grid.shape_slice);
  float u_i = mm_forward(grid.parameterization, mm_chord(wi, n), grid.shape_row);
  vector ti = normalize(vector(wi[0], wi[1], 0));
  vector to = normalize(vector(wo[0], wo[1], 0));
  float near = length(ti - to);
  float far = length(ti + to);
  float s = mm_forward(grid.parameterization, min(min(near, far) * M_SQRT1_2, 1.0), grid.shape_phi);
  return vector(u_o, u_i, near > far ? 0.5 - 0.5 * s : 0.5 + 0.5 * s);
}

// bake/tables/grids/parameterization.py: half_basis_coordinates, (u_d, u_h, u_phi)
vector mm_half_coordinates(MMGrid grid, vector wi, vector wo)
{
  string others = grid.parameterization == "squared" ? "uniform" : grid.parameterization;
  vector total = wi + wo;
  vector apart = wi - wo;
  vector h = normalize(total);
  vector phi = normalize(
      vector(abs(length(total) * apart[2]), abs(total[0] * apart[1] - total[1] * apart[0]), 0));
  float up = max(total[2], 0.0);
  float aside = length(vector(total[0], total[1], 0)) * phi[0];
  float radius = sqrt(up * up + aside * aside);
  float v_d = length(apart) / sqrt(2 * length(total) + 4);
  v_d = min(v_d / (up / sqrt(radius * (radius + aside))), 1.0);
  float u_d = mm_forward(others, v_d, grid.shape_slice);
  float u_h = mm_forward(grid.parameterization, mm_chord(h, vector(0, 0, 1)), grid.shape_row);
  float u_phi = mm_forward(others, mm_chord(phi, vector(1, 0, 0)), grid.shape_phi);
  if (!grid.reciprocal)
    u_phi = apart[2] > 0 ? 0.5 - 0.5 * u_phi : 0.5 + 0.5 * u_phi;
  return vector(u_d, u_h, u_phi);
}

// The coordinates in [0, 1] of an isotropic grid.
vector mm_coordinates(MMGrid grid, vector wi, vector wo)
{
  return startswith(grid.basis, "half") ? mm_half_coordinates(grid, wi, wo) : mm_normal_coordinates(grid, wi, wo);
}

// bake/tables/grids/anisotropic_grids.py: AnisotropicNormalGrid.coordinates
void mm_normal_place(MMGrid grid, vector wi, vector wo, output float at[4])
{
  vector viewer = wo + vector(1e-12, 0, 0);
  vector u = mm_normal_coordinates(grid, wi, viewer);
  float turn = viewer[0] * wi[1] < wi[0] * viewer[1] ? 1 + u[2] : 1 - u[2];
  at[0] = mm_azimuth_index(viewer[0], viewer[1], grid.azimuths, grid.folded);
  at[1] = u[0] * (grid.slices - 1);
  at[2] = u[1] * (grid.slice_rows - 1);
  at[3] = turn * (grid.slice_columns / 2);
}

// bake/tables/grids/anisotropic_grids.py: AnisotropicHalfGrid.coordinates
void mm_slope_place(MMGrid grid, vector wi, vector wo, output float at[4])
{
  vector total = wi + wo;
  total[2] = max(total[2], 2 * MM_LEAST_SUM);
  vector h = normalize(total);
  float lift = (dot(wi, h) + wi[2]) / (1 + h[2]);
  at[0] = mm_azimuth_index(wi[0] - h[0] * lift, wi[1] - h[1] * lift, grid.azimuths, grid.folded);
  at[1] = (1 - min(length(wi - h) * M_SQRT1_2, 1.0)) * (grid.slices - 1);
  at[2] = (0.5 + 0.5 * mm_slope_warp(total[1] / total[2], grid.shape_row[0])) * (grid.slice_rows - 1);
  at[3] = (0.5 + 0.5 * mm_slope_warp(total[0] / total[2], grid.shape_phi[0])) * (grid.slice_columns - 1);
}

// bake/patches.py: PatchBasis.index of the parameterization's patches in KLEMS
float mm_patch(string patches, vector w)
{
  float bounds[8] = {5, 15, 25, 35, 45, 55, 65, 75};
  float azimuths[9] = {1, 8, 16, 20, 24, 24, 24, 16, 12};
  int rings = 9;
  if (patches == "klems half") {
    float half_bounds[6] = {6.5, 19.5, 32.5, 46.5, 61.5, 76.5};
    float half_azimuths[7] = {1, 8, 12, 16, 20, 12, 4};
    rings = 7;
    for (int k = 0; k < 6; ++k)
      bounds[k] = half_bounds[k];
    for (int k = 0; k < 7; ++k)
      azimuths[k] = half_azimuths[k];
  }
  else if (patches == "klems quarter") {
    float quarter_bounds[4] = {9, 27, 46, 66};
    float quarter_azimuths[5] = {1, 8, 12, 12, 8};
    rings = 5;
    for (int k = 0; k < 4; ++k)
      bounds[k] = quarter_bounds[k];
    for (int k = 0; k < 5; ++k)
      azimuths[k] = quarter_azimuths[k];
  }
  float first = 0;
  float number = azimuths[0];
  for (int k = 0; k < rings - 1; ++k)
    if (w[2] < cos(radians(bounds[k]))) {
      first += azimuths[k];
      number = azimuths[k + 1];
    }
  float turn = floor(atan2(w[1], w[0]) * (0.5 / M_PI) * number + 0.5);
  return first + (number < 1.5 ? 0 : (turn < -0.5 ? turn + number : turn));
}

// bake/tables/grids/patch_grid.py: PatchGrid.coordinates
void mm_patch_place(MMGrid grid, vector wi, vector wo, output float at[4])
{
  float light = mm_patch(grid.parameterization, wi);
  at[0] = 0;
  at[1] = mm_patch(grid.parameterization, wo);
  at[2] = floor((light + 0.5) / grid.slice_columns);
  at[3] = light - at[2] * grid.slice_columns;
}

// Fractional indices of azimuth, slice, row and column; without azimuths the first is 0.
void mm_place(MMGrid grid, vector wi, vector wo, output float at[4])
{
  if (grid.basis == "patches")
    mm_patch_place(grid, wi, wo, at);
  else if (grid.azimuths > 0 && startswith(grid.basis, "half"))
    mm_slope_place(grid, wi, wo, at);
  else if (grid.azimuths > 0)
    mm_normal_place(grid, wi, wo, at);
  else {
    vector u = mm_coordinates(grid, wi, wo);
    at[0] = 0;
    at[1] = u[0] * (grid.slices - 1);
    at[2] = u[1] * (grid.slice_rows - 1);
    at[3] = u[2] * (grid.slice_columns - 1);
  }
}

// `factor` of the grids: what a BRDF is multiplied by to be stored
float mm_factor(MMGrid grid, vector wi, vector wo)
{
  if (!startswith(grid.basis, "half") || (grid.azimuths == 0 && grid.basis == "half"))
    return 1.0;
  float factor = max(0.5 * (wi[2] + wo[2]), MM_LEAST_SUM);
  return grid.basis == "half squared" ? factor * max(0.5 * length(wi + wo), MM_LEAST_SUM) : factor;
}

// bake/tables/atlas.py: atlas_uv, and the texture there. Indices are whole: an azimuth is at most two beyond its ends and goes
// round; one slice lies beyond the pole.
color mm_slice(MMTable table, MMGrid grid, float azimuth, float slice, float row, float column)
{
  float index = clamp(slice, 0.0, grid.slices);
  if (grid.azimuths > 0) {
    float count = grid.azimuths;
    float around = azimuth > count - 0.5 ? azimuth - count : (azimuth < -0.5 ? azimuth + count : azimuth);
    index += around * (grid.slices + 1);
  }
  int width = grid.slice_columns + 2 * MM_GUTTER;
  int height = grid.slice_rows + 2 * MM_GUTTER;
  float down = floor((index + 0.5) / table.columns);
  float across = index - down * table.columns;
  float x = across * width + column + (MM_GUTTER + 0.5);
  float y = down * height + row + (MM_GUTTER + 0.5);
  string interpolation = "linear";
  if (table.filter == "nearest")
    interpolation = "closest";
  else if (table.filter == "bspline")
    interpolation = "cubic";
  float alpha;
  color texel = mm_tap(table.image, x / (table.columns * width), y / (table.rows * height), interpolation, alpha);
  return mm_decode(texel, table.log_range, table.log_gain);
}

// bake/tables/table.py: bspline_weights
void mm_bspline_weights(float t, output float weights[4])
{
  float r = 1 - t;
  weights[0] = r * r * r / 6;
  weights[1] = (t * t) * (0.5 * t - 1) + 2.0 / 3;
  weights[2] = (r * r) * (0.5 * r - 1) + 2.0 / 3;
  weights[3] = t * t * t / 6;
}

// Weights of the taps along one axis, the position's share behind the tap before it; how many there are.
int mm_filter_weights(string filter, float t, output float weights[4])
{
  if (filter == "bspline") {
    mm_bspline_weights(t, weights);
    return 4;
  }
  weights[0] = 1 - t;
  weights[1] = t;
  weights[2] = 0;
  weights[3] = 0;
  return 2;
}

// nodes/table_lookup_group.py: _passed and _rest
int mm_chosen(float weights[4], int count, float random, output float rest)
{
  int place = 0;
  float below = weights[0];
  float start = 0;
  for (int k = 1; k < count; ++k) {
    if (random > below) {
      place = k;
      start = below;
    }
    below += weights[k];
  }
  rest = clamp((random - start) / weights[place], 0.0, 1.0);
  return place;
}

// nodes/table_lookup_group.py: the BRDF in 1/sr without the cosine, saturated
color mm_lookup(MMTable table, MMGrid grid, vector wi, vector wo, float random)
{
  float at[4];
  mm_place(grid, wi, wo, at);
  color value = 0;
  if (table.filter == "nearest")
    value = mm_slice(table, grid, floor(at[0] + 0.5), floor(at[1] + 0.5), at[2], at[3]);
  else {
    float a = floor(at[0]);
    float b = floor(at[1]);
    float weights_a[4] = {1, 0, 0, 0};
    float weights_b[4];
    int count_b = mm_filter_weights(table.filter, at[1] - b, weights_b);
    int count_a = 1;
    if (grid.azimuths > 0)
      count_a = mm_filter_weights(table.filter, at[0] - a, weights_a);
    if (table.filter == "bspline") {
      a -= 1;
      b -= 1;
    }
    if (table.stochastic) {
      float rest;
      float unused;
      int j = mm_chosen(weights_b, count_b, random, rest);
      int i = mm_chosen(weights_a, count_a, rest, unused);
      if (grid.azimuths == 0 && count_b == 2)
        j = random < weights_b[1];
      value = mm_slice(table, grid, a + i, b + j, at[2], at[3]);
    }
    else
      for (int i = 0; i < count_a; ++i)
        for (int j = 0; j < count_b; ++j)
          value += weights_a[i] * weights_b[j] * mm_slice(table, grid, a + i, b + j, at[2], at[3]);
  }
  return mm_saturated((value - table.offset) * (table.scale / mm_factor(grid, wi, wo)), table.saturation);
}

#endif
