// Aiming at the bright parts of the world: twin of bake/sampling/world.py, which says why. The world's table lives in the
// .blend and is tapped by image nodes between our scripts: OSL would read a file once, and show it for good.

#ifndef MEASURED_WORLD_H
#define MEASURED_WORLD_H

#include "measured_math.h"

#define MM_WORLD_COLUMNS 512 // bake/sampling/world.py: COLUMNS, ROWS
#define MM_WORLD_ROWS 256
#define MM_WORLD_MARGIN 2.5e-4
#define MM_BELOW_ONE 0.99999994 // the last float below 1

// The texel of the cell that two random numbers choose, of a table of so many: column and row of the alias, acceptance.
struct MMWorldCell {
  float columns;
  float rows;
  color alias;
  float acceptance;
};

// choose_cell: texture coordinates to read, of v upwards
vector mm_world_place(float columns, float rows, float u1, float u2)
{
  float column = floor(u1 * (columns * MM_BELOW_ONE));
  float row = floor(u2 * (rows * MM_BELOW_ONE));
  return vector((column + 0.5) / columns, (row + 0.5) / rows, 0);
}

// choose_cell and draw_in_world
vector mm_draw_in_world(MMWorldCell cell, int keep, float u1, float u2)
{
  float across = u1 * (cell.columns * MM_BELOW_ONE);
  float up = u2 * (cell.rows * MM_BELOW_ONE);
  float column = floor(across);
  float row = floor(up);
  float place_x = (across - column) * (1 - 2 * MM_WORLD_MARGIN) + MM_WORLD_MARGIN;
  float place_y = (up - row) * (1 - 2 * MM_WORLD_MARGIN) + MM_WORLD_MARGIN;
  float azimuth = ((keep ? column : cell.alias[0]) + place_x) * (M_2PI / cell.columns) - M_PI;
  float z = ((keep ? row : cell.alias[1]) + place_y) * (2 / cell.rows) - 1;
  float sine = sqrt(1 - z * z);
  return vector(sine * cos(azimuth), sine * sin(azimuth), z);
}

// world_coordinates
vector mm_world_coordinates(vector wi)
{
  return vector(mm_arctan2(wi[1], wi[0]) * (0.5 / M_PI) + 0.5, wi[2] * 0.5 + 0.5, 0);
}

// Of a direction of measured_aim.osl: from its densities, its texel of the world's table, and its density by the sampler.
float mm_whole_density(vector densities, color texel, float of_sampler)
{
  float whole = densities[0] + densities[2] * of_sampler;
  // What is not read is not computed.
  if (densities[1] > 0)
    whole += densities[1] * texel[2];
  return whole;
}

// expected_world_light
float mm_expected_world_light(vector toward, float flux, vector n)
{
  return max(dot(toward, n) + flux, 0.1 * flux);
}

// expected_world_light_on_sheet
float mm_expected_world_light_on_sheet(vector toward, float flux, vector n, float front)
{
  return mm_expected_world_light(toward, flux, n) * front + mm_expected_world_light(toward, flux, -n) * (1 - front);
}

#endif
