// What the OSL shaders of Measured Materials share: hand-written twins of formulas in bake/ and nodes/, each named
// beside its function. Directions are unit vectors; "local" is the frame (t, b, n) with z = n; I points to the viewer.
//
// OSL's quotient by 0 is 0, and its normalize() keeps the zero vector, as `xp.divide` and `xp.normalize` do. Its arcsine
// and arctangent are fast and wrong by up to 1e-4; the functions here mend them by a Newton step. Textures are read
// from files, by OSL's own texture system: untouched by colour management, row 0 on top, hence t = 0 there.

#ifndef MEASURED_MATERIALS_H
#define MEASURED_MATERIALS_H

#include "stdcycles.h"

#define MM_GUTTER 2          // bake/tables/padding.py
#define MM_MIN_COSINE 1e-3   // nodes/local_frame_group.py
#define MM_LEAST_WEIGHT 2e-5 // above that of nodes/stochastic_mirror_group.py, where a metal carries most of these

// A tabulated BRDF: the atlas of bake/tables/atlas.py, and what its values are multiplied by, or their codes stand for.
struct MMTable {
  string image;
  float scale;
  float offset;
  vector log_range;
  vector log_gain;
  int slices;
  int slice_rows;
  int slice_columns;
  int columns;
  int rows;
  string filter;
  int stochastic;
};

// Where its samples lie: bake/tables/normal_grid.py or half_vector_grid.py. A shape is Bezier's alpha in [0], or the
// constants of a LogWarp.
struct MMGrid {
  string basis;
  string parameterization;
  vector shape_slice;
  vector shape_row;
  vector shape_phi;
  int reciprocal;
};

// Alias tables of bake/sampling/half_vector_cells.py.
struct MMSampler {
  string image;
  int bins;
  int cells_theta;
  int cells_phi;
  int warp;
};

// The shading normal, the viewer in its local frame, and the tangents.
struct MMFrame {
  vector wo;
  vector tangent;
  vector bitangent;
  vector n;
};

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

// bake/parameterization.py: forward
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

// bake/parameterization.py: normal_basis_coordinates, (u_o, u_i, u_phi)
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

// bake/parameterization.py: half_basis_coordinates, (u_d, u_h, u_phi)
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

vector mm_coordinates(MMGrid grid, vector wi, vector wo)
{
  return grid.basis == "half" ? mm_half_coordinates(grid, wi, wo) : mm_normal_coordinates(grid, wi, wo);
}

// bake/tables/atlas.py: atlas_uv, and the texture there
color mm_slice(MMTable table, float index, float u_row, float u_phi)
{
  int width = table.slice_columns + 2 * MM_GUTTER;
  int height = table.slice_rows + 2 * MM_GUTTER;
  float row = floor((index + 0.5) / table.columns);
  float column = index - row * table.columns;
  float x = column * width + u_phi * (table.slice_columns - 1) + (MM_GUTTER + 0.5);
  float y = row * height + u_row * (table.slice_rows - 1) + (MM_GUTTER + 0.5);
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

color mm_bspline_slices(MMTable table, float base, float t, vector u, float random)
{
  float weights[4];
  mm_bspline_weights(t, weights);
  float last = table.slices; // one slice lies beyond the pole
  color value = 0;
  if (table.stochastic) {
    float below = weights[0];
    float passed = 0;
    for (int k = 1; k < 4; ++k) {
      passed += random > below;
      below += weights[k];
    }
    value = mm_slice(table, clamp(base - 1 + passed, 0.0, last), u[1], u[2]);
  }
  else {
    for (int k = 0; k < 4; ++k)
      value += weights[k] * mm_slice(table, clamp(base - 1 + k, 0.0, last), u[1], u[2]);
  }
  return value;
}

// nodes/table_lookup_group.py: the BRDF in 1/sr without the cosine
color mm_lookup(MMTable table, MMGrid grid, vector wi, vector wo, float random)
{
  vector u = mm_coordinates(grid, wi, wo);
  float position = u[0] * (table.slices - 1);
  color value = 0;
  if (table.filter == "nearest")
    value = mm_slice(table, floor(position + 0.5), u[1], u[2]);
  else {
    float base = floor(position);
    float t = position - base;
    if (table.filter == "bspline")
      value = mm_bspline_slices(table, base, t, u, random);
    else if (table.stochastic)
      value = mm_slice(table, base + (random < t), u[1], u[2]);
    else
      value = (1 - t) * mm_slice(table, base, u[1], u[2]) + t * mm_slice(table, base + 1, u[1], u[2]);
  }
  return (value - table.offset) * table.scale;
}

color mm_sampler_texel(MMSampler sampler, float bin, float cell, output float alpha)
{
  int cells = sampler.cells_theta * sampler.cells_phi;
  return mm_tap(sampler.image, (cell + 0.5) / cells, (bin + 0.5) / sampler.bins, "closest", alpha);
}

// Index in 0 to count - 1 of a position in [0, 1], both ends included.
float mm_index(float position, int count)
{
  return min(floor(position * count), count - 1.0);
}

float mm_cell_edge(MMSampler sampler, float index)
{
  float x = index / sampler.cells_theta;
  float edge = x * x;
  for (int k = 1; k < sampler.warp; ++k)
    edge *= x * x;
  return edge;
}

// bake/sampling/cell_sampler.py: reflect_from_cell, with half_vector_cells.py; local wi and its density
vector mm_draw(
    MMSampler sampler, vector wo, float u_cell, float u_alias, float u_theta, float u_phi, output float pdf)
{
  float bin = mm_index(mm_chord(wo, vector(0, 0, 1)), sampler.bins);
  float cell = mm_index(u_cell, sampler.cells_theta * sampler.cells_phi);
  float alias_pdf;
  color texel = mm_sampler_texel(sampler, bin, cell, alias_pdf);
  int keep = u_alias < texel[0];
  float pdf_h = keep ? texel[2] : alias_pdf;
  float chosen = keep ? cell : texel[1];
  float i_theta = floor((chosen + 0.5) / sampler.cells_phi);
  float i_phi = chosen - i_theta * sampler.cells_phi;
  float low = mm_cell_edge(sampler, i_theta);
  float m = low + u_theta * (mm_cell_edge(sampler, i_theta + 1) - low);
  // One number serves side and place in the cell: the upper half of [0, 1] is one side, the lower the other.
  int side = u_phi > 0.5;
  float phi = (i_phi + (side ? 2 * u_phi - 1 : 2 * u_phi)) * (M_PI / sampler.cells_phi);
  float sine = sqrt(m * (2 - m));
  vector h = vector(sine * cos(phi), sine * sin(phi) * (side ? 1 : -1), 1 - m);
  float wo_half = dot(wo, h);
  pdf = pdf_h / (4 * max(wo_half, 1e-6));
  return 2 * wo_half * h - wo;
}

// bake/sampling/half_vector_cells.py: the density with which mm_draw gives wi
float mm_density(MMSampler sampler, vector wi, vector wo)
{
  vector h = normalize(wi + wo);
  vector apart = h - vector(0, 0, 1);
  float m = dot(apart, apart) * 0.5;
  float i_phi = mm_index(abs(mm_arctan2(h[1], h[0])) / M_PI, sampler.cells_phi);
  // The root by square roots where they serve: pow() is fast and wrong by 1e-5.
  float root = sqrt(m);
  if (sampler.warp == 2)
    root = sqrt(root);
  else if (sampler.warp != 1)
    root = pow(root, 1.0 / sampler.warp);
  float i_theta = mm_index(root, sampler.cells_theta);
  float bin = mm_index(mm_chord(wo, vector(0, 0, 1)), sampler.bins);
  float alias_pdf;
  color texel = mm_sampler_texel(sampler, bin, i_theta * sampler.cells_phi + i_phi, alias_pdf);
  return texel[2] / (4 * max(dot(wo, h), 1e-6));
}

// nodes/local_frame_group.py: viewer_frame
MMFrame mm_viewer_frame(vector n, vector incoming)
{
  vector across = cross(n, incoming);
  float sine = length(across);
  float cosine = max(dot(n, incoming), MM_MIN_COSINE);
  vector axis = n[0] * n[0] > 0.5 ? vector(0, 1, 0) : vector(1, 0, 0);
  MMFrame frame;
  // Close to the normal the cross product is rounding noise, and no azimuth matters: any tangent serves.
  frame.bitangent = normalize(sine > 1e-4 ? across : cross(n, axis));
  frame.tangent = cross(frame.bitangent, n);
  frame.wo = normalize(vector(sine, 0, cosine));
  frame.n = n;
  return frame;
}

vector mm_to_world(MMFrame frame, vector w)
{
  return w[0] * frame.tangent + w[1] * frame.bitangent + w[2] * frame.n;
}

vector mm_to_local(MMFrame frame, vector w)
{
  return vector(dot(w, frame.tangent), dot(w, frame.bitangent), dot(w, frame.n));
}

// nodes/stochastic_mirror_group.py: nine independent numbers in [0, 1], fresh for every ray. Places
// in a triangle may differ where positions are one in float32; parametric_u and _v are OSL's u and v.
void mm_random(point position, vector incoming, float parametric_u, float parametric_v, output float numbers[9])
{
  float within = 1 - parametric_u - parametric_v + 1.618034 * parametric_u;
  color ray = noise("hash", point(incoming), within);
  for (int k = 0; k < 3; ++k) {
    color three = noise("hash", position, ray[k]);
    numbers[3 * k] = three[0];
    numbers[3 * k + 1] = three[1];
    numbers[3 * k + 2] = three[2];
  }
}

// nodes/stochastic_mirror_group.py: mirror_closure, without the roulette
closure color mm_mirror(vector wi, vector incoming, color weight)
{
  return max(weight, color(0)) * microfacet("ggx", normalize(wi + incoming), vector(0), 0.0, 0.0, 0.0, 0);
}

// Weights that Cycles would drop live on by Russian roulette, raised as often as keeps their mean.
color mm_roulette(color weight, float random)
{
  float keep = min((weight[0] + weight[1] + weight[2]) / (3 * MM_LEAST_WEIGHT), 1.0);
  return random < keep ? weight / keep : color(0);
}

// nodes/native_closure.py: `parameter` is alpha of "ggx", sigma of "sheen", roughness of "oren_nayar"
closure color mm_native(string name, float parameter, normal n)
{
  if (name == "ggx")
    return microfacet("ggx", n, vector(0), parameter, parameter, 0.0, 0);
  if (name == "sheen")
    return ashikhmin_velvet(n, parameter);
  if (name == "oren_nayar" && parameter > 0)
    return oren_nayar_diffuse_bsdf(n, color(1), parameter);
  return diffuse(n);
}

// bake/envelope/texture.py: texture_coordinate
float mm_weight_coordinate(vector wo, int nodes)
{
  return mm_chord(wo, vector(0, 0, 1)) * (nodes - 1) / nodes + 0.5 / nodes;
}

// bake/envelope/texture.py: mirror_probability, at the eagerness that nodes/exact_closure.py asks for
float mm_mirror_probability(float share)
{
  float eagerness = 1;
  return share * eagerness / (share * eagerness + (1 - share));
}

#endif
