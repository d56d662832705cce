// Anisotropic tables for the OSL shaders: twins of bake/anisotropic, each named beside its function.

#ifndef MEASURED_ANISOTROPIC_H
#define MEASURED_ANISOTROPIC_H

#include "measured_materials.h"

#define MM_LEAST_SUM 1e-3       // bake/tables/anisotropic_grids.py
#define MM_CELL_EDGE 0.999999   // bake/sampling/slope_cells.py

// A four-dimensional table: the atlas of bake/tables/atlas.py, its grid's sizes [a, b, r, c], and the shapes of
// two kinds of axes: in the half basis the slope widths along x and y, first of each; in the normal one what mm_forward
// takes for the elevations and for phi_delta.
struct MMTable4 {
  string image;
  float scale;
  float offset;
  vector log_range;
  vector log_gain;
  string basis;
  int sizes[4];
  int columns;
  int rows;
  string parameterization;
  vector shape[2];
  int folded;
  string filter;
  int stochastic;
};

// Alias tables of bake/sampling/slope_cells.py.
struct MMSlopes {
  string image;
  int n_theta;
  int n_phi;
  int n_x;
  int n_y;
  float width_x;
  float width_y;
  int folded;
};

// azimuth_index
float mm_azimuth_index(float x, float y, int n, int folded)
{
  float turns = mm_arctan2(y, x) * ((folded ? 1.0 : 0.5) / M_PI);
  return (turns < 0 ? turns + 1 : turns) * n;
}

float mm_slope_warp(float x, float width)
{
  return x / (width + abs(x));
}

float mm_slope_unwarp(float u, float width)
{
  return width * u / (1 - abs(u));
}

// AnisotropicNormalGrid.coordinates
void mm_normal_coordinates4(MMTable4 table, vector wi, vector wo, output float at[4])
{
  MMGrid grid = {"normal", table.parameterization, table.shape[0], table.shape[0], table.shape[1], 0};
  vector viewer = wo + vector(1e-12, 0, 0);
  vector u = mm_coordinates(grid, wi, viewer);
  float turn = viewer[0] * wi[1] < wi[0] * viewer[1] ? 1 + u[2] : 1 - u[2];
  at[0] = mm_azimuth_index(viewer[0], viewer[1], table.sizes[0], table.folded);
  at[1] = u[0] * (table.sizes[1] - 1);
  at[2] = u[1] * (table.sizes[2] - 1);
  at[3] = turn * (table.sizes[3] / 2);
}

// AnisotropicHalfGrid.coordinates
void mm_half_coordinates4(MMTable4 table, vector wi, vector wo, output float at[4])
{
  vector total = wi + wo;
  total[2] = max(total[2], 2 * MM_LEAST_SUM);
  vector h = normalize(total);
  float lift = (dot(wi, h) + wi[2]) / (1 + h[2]);
  at[0] = mm_azimuth_index(wi[0] - h[0] * lift, wi[1] - h[1] * lift, table.sizes[0], table.folded);
  at[1] = (1 - min(length(wi - h) * M_SQRT1_2, 1.0)) * (table.sizes[1] - 1);
  at[2] = (0.5 + 0.5 * mm_slope_warp(total[1] / total[2], table.shape[1][0])) * (table.sizes[2] - 1);
  at[3] = (0.5 + 0.5 * mm_slope_warp(total[0] / total[2], table.shape[0][0])) * (table.sizes[3] - 1);
}

// bake/tables/atlas.py: atlas_uv, and the texture there; a and b whole, a at most two beyond its ends
color mm_slice4(MMTable4 table, float a, float b, float r, float c)
{
  int count = table.sizes[0];
  float around = a > count - 0.5 ? a - count : (a < -0.5 ? a + count : a);
  float index = around * (table.sizes[1] + 1) + clamp(b, 0.0, table.sizes[1]);
  int width = table.sizes[3] + 2 * MM_GUTTER;
  int height = table.sizes[2] + 2 * MM_GUTTER;
  float row = floor((index + 0.5) / table.columns);
  float column = index - row * table.columns;
  float x = column * width + c + (MM_GUTTER + 0.5);
  float y = row * height + r + (MM_GUTTER + 0.5);
  string interpolation = "linear";
  if (table.filter == "nearest")
    interpolation = "closest";
  else if (table.filter == "bspline")
    interpolation = "cubic";
  float alpha;
  color texel = mm_tap(table.image, x / (table.columns * width), y / (table.rows * height), interpolation, alpha);
  return mm_decode(texel, table.log_range, table.log_gain);
}

// nodes/anisotropic_groups.py: _chosen
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

// nodes/anisotropic_groups.py: the BRDF in 1/sr without the cosine
color mm_lookup4(MMTable4 table, vector wi, vector wo, float random)
{
  float at[4];
  float factor = 1;
  if (startswith(table.basis, "half")) {
    mm_half_coordinates4(table, wi, wo, at);
    factor = max(0.5 * (wi[2] + wo[2]), MM_LEAST_SUM);
    if (table.basis == "half squared")
      factor *= max(0.5 * length(wi + wo), MM_LEAST_SUM);
  }
  else
    mm_normal_coordinates4(table, wi, wo, at);
  color value = 0;
  if (table.filter == "nearest")
    value = mm_slice4(table, floor(at[0] + 0.5), floor(at[1] + 0.5), at[2], at[3]);
  else {
    float a = floor(at[0]);
    float b = floor(at[1]);
    float weights_a[4] = {1 - (at[0] - a), at[0] - a, 0, 0};
    float weights_b[4] = {1 - (at[1] - b), at[1] - b, 0, 0};
    int count = 2;
    if (table.filter == "bspline") {
      mm_bspline_weights(at[0] - a, weights_a);
      mm_bspline_weights(at[1] - b, weights_b);
      count = 4;
      a -= 1;
      b -= 1;
    }
    if (table.stochastic) {
      float rest;
      int j = mm_chosen(weights_b, count, random, rest);
      float unused;
      int i = mm_chosen(weights_a, count, rest, unused);
      value = mm_slice4(table, a + i, b + j, at[2], at[3]);
    }
    else
      for (int i = 0; i < count; ++i)
        for (int j = 0; j < count; ++j)
          value += weights_a[i] * weights_b[j] * mm_slice4(table, a + i, b + j, at[2], at[3]);
  }
  return (value - table.offset) * (table.scale / factor);
}

// SlopeLayout.bin_of
float mm_viewer_bin(MMSlopes slopes, vector wo)
{
  float azimuth = floor(mm_azimuth_index(wo[0], wo[1], slopes.n_phi, slopes.folded) + 0.5);
  if (azimuth > slopes.n_phi - 0.5)
    azimuth = 0;
  return mm_index(mm_chord(wo, vector(0, 0, 1)), slopes.n_theta) * slopes.n_phi + azimuth;
}

// SlopeLayout.side
float mm_turned(MMSlopes slopes, vector wo)
{
  if (!slopes.folded)
    return 1;
  float index = 2 * mm_azimuth_index(wo[0], wo[1], slopes.n_phi, 0);
  return index > slopes.n_phi - 0.5 && index < 2 * slopes.n_phi - 0.5 ? -1 : 1;
}

// _density
float mm_slope_density(MMSlopes slopes, float x, float y, float h_z, float wo_half)
{
  float to_x = slopes.width_x + abs(x);
  float to_y = slopes.width_y + abs(y);
  float spread = to_x * to_x * to_y * to_y * (h_z * h_z * h_z) * max(wo_half, 1e-6);
  return (slopes.width_x * slopes.width_y / 16) / spread;
}

color mm_slope_texel(MMSlopes slopes, float bin, float cell, output float alpha)
{
  int cells = slopes.n_x * slopes.n_y;
  int bins = slopes.n_theta * slopes.n_phi;
  return mm_tap(slopes.image, (cell + 0.5) / cells, (bin + 0.5) / bins, "closest", alpha);
}

// reflect_from_cell; local wi and its density
vector mm_draw4(
    MMSlopes slopes, vector wo, float u_cell, float u_alias, float u_x, float u_y, output float pdf)
{
  float cell = mm_index(u_cell, slopes.n_x * slopes.n_y);
  float alias_weight;
  color texel = mm_slope_texel(slopes, mm_viewer_bin(slopes, wo), cell, alias_weight);
  int keep = u_alias < texel[0];
  float chosen = keep ? cell : texel[1];
  float i_y = floor((chosen + 0.5) / slopes.n_x);
  float i_x = chosen - i_y * slopes.n_x;
  float side = mm_turned(slopes, wo);
  float x = side * mm_slope_unwarp(clamp((i_x + u_x) * (2.0 / slopes.n_x) - 1, -MM_CELL_EDGE, MM_CELL_EDGE),
                                   slopes.width_x);
  float y = side * mm_slope_unwarp(clamp((i_y + u_y) * (2.0 / slopes.n_y) - 1, -MM_CELL_EDGE, MM_CELL_EDGE),
                                   slopes.width_y);
  vector h = normalize(vector(x, y, 1));
  float wo_half = dot(wo, h);
  pdf = (keep ? texel[2] : alias_weight) * mm_slope_density(slopes, x, y, h[2], wo_half);
  return 2 * wo_half * h - wo;
}

// find_texel; the density with which mm_draw4 gives wi
float mm_density4(MMSlopes slopes, vector wi, vector wo)
{
  vector total = wi + wo;
  total[2] = max(total[2], 1e-6);
  vector h = normalize(total);
  float x = total[0] / total[2];
  float y = total[1] / total[2];
  float side = mm_turned(slopes, wo);
  float i_x = mm_index(0.5 + 0.5 * mm_slope_warp(side * x, slopes.width_x), slopes.n_x);
  float i_y = mm_index(0.5 + 0.5 * mm_slope_warp(side * y, slopes.width_y), slopes.n_y);
  float alpha;
  color texel = mm_slope_texel(slopes, mm_viewer_bin(slopes, wo), i_y * slopes.n_x + i_x, alpha);
  return texel[2] * mm_slope_density(slopes, x, y, h[2], dot(wo, h));
}

// nodes/tangent_frame_group.py: tangent_frame
MMFrame mm_tangent_frame(vector n, vector incoming, vector along)
{
  vector across = cross(n, along);
  vector axis = n[0] * n[0] > 0.5 ? vector(0, 1, 0) : vector(1, 0, 0);
  MMFrame frame;
  frame.bitangent = normalize(length(across) > 1e-6 ? across : cross(n, axis));
  frame.tangent = cross(frame.bitangent, n);
  frame.wo = normalize(vector(
      dot(incoming, frame.tangent), dot(incoming, frame.bitangent), max(dot(incoming, n), MM_MIN_COSINE)));
  frame.n = n;
  return frame;
}

// bake/envelope/texture.py: row_coordinate, the texel of closure k of `count` for a viewer
color mm_closure_weight(string image, int n_theta, int n_phi, int folded, int k, int count, vector wo, output float alpha)
{
  float row = mm_azimuth_index(wo[0], wo[1], n_phi, folded) + k * (n_phi + 2) + 1.5;
  return mm_tap(image, mm_weight_coordinate(wo, n_theta), row / (count * (n_phi + 2)), "linear", alpha);
}

#endif
