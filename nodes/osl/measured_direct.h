// Light of the scene's lamps that a table reflects, sampled in the shader and shown as emission: twin of
// bake/sampling/lamp_light.py (addon/docs/method.md, section 10).

#ifndef MEASURED_DIRECT_H
#define MEASURED_DIRECT_H

#include "measured_lamps.h"

#define MM_SPREAD 1
#define MM_SPOT 2
#define MM_SHORT 0.9999 // of the way to a lamp, so that what stands just behind it casts no shadow
#define MM_ENDLESS 1e30
#define MM_BEHIND 0.01
#define MM_FAR_BRIGHTER 100
#define MM_LEAST_FOLLOWED 0.02

// A lamp as seen from a point: mm_aim_at, but for a disk that faces the point, whose cone is narrower than its sphere's.
MMAim mm_lamp_seen(MMLamp lamp, point position)
{
  MMAim aim = mm_aim_at(lamp, position);
  if (aim.kind > MM_SPHERE - 0.5 && aim.kind < MM_SUN - 0.5 && lamp.facing > 0.5) {
    float square = aim.fourth * aim.fourth;
    float ratio = square / (dot(aim.to_centre, aim.to_centre) + square);
    aim.m = ratio / (1 + sqrt(1 - ratio));
  }
  return aim;
}

// lamp_light.py: distance_along, to where a direction that meets the lamp does so
float mm_distance_along(MMAim aim, vector wi, float disk)
{
  if (aim.kind > MM_SUN - 0.5)
    return MM_ENDLESS;
  if (aim.kind < MM_SPHERE - 0.5)
    return dot(aim.emission, aim.to_centre) / dot(aim.emission, wi);
  float square = dot(aim.to_centre, aim.to_centre);
  float along = dot(aim.to_centre, wi);
  if (disk > 0.5)
    return square / along;
  float side = square < aim.fourth * aim.fourth ? 1 : -1; // from inside a ball the ray meets its far side
  return along + side * sqrt(max(aim.fourth * aim.fourth - square + along * along, 0.0));
}

// lamp_light.py: beam
float mm_beam(MMLamp lamp, vector wi)
{
  float cosine = -dot(lamp.axis, wi);
  if (lamp.beam[0] > MM_SPOT - 0.5) {
    float t = clamp((cosine - lamp.beam[1]) * lamp.beam[2], 0.0, 1.0);
    return t * t * (3 - 2 * t);
  }
  if (lamp.beam[0] > MM_SPREAD - 0.5) {
    float tangent = sqrt(max(1 - cosine * cosine, 0.0)) / max(cosine, 1e-6);
    return max((lamp.beam[1] - tangent) * lamp.beam[2], 0.0);
  }
  return 1;
}

// Whether nothing stands between a position and a lamp in a direction that meets it.
int mm_visible(MMLamp lamp, MMAim aim, point position, vector wi)
{
  return !trace(position, wi, "maxdist", mm_distance_along(aim, wi, lamp.facing) * MM_SHORT);
}

// The numbers of point j of a lamp: the second lies opposite of the first, the third and fourth beside.
void mm_opposite(float kind, int j, float u1, float u2, output float s, output float t)
{
  s = u1;
  t = u2;
  if (kind > MM_ELLIPSE - 0.5)
    t = u2 + (j == 1 ? 0.5 : (j == 2 ? 0.25 : (j == 3 ? 0.75 : 0.0)));
  else {
    if (j == 1 || j == 2)
      s = 1 - u1;
    if (j == 1 || j == 3)
      t = 1 - u2;
  }
}

// A direction towards point j of a lamp, its density by all of the lamp's points, and the radiance that would come from
// there; 0 where none does.
color mm_point_of(
    MMLamp lamp, MMAim aim, int points, int j, float u1, float u2, output vector wi, output float density)
{
  float s, t;
  mm_opposite(aim.kind, j, u1, u2, s, t);
  wi = mm_draw_towards(aim, s, t);
  density = points * mm_density_towards(aim, wi, 1);
  return density > 0 ? color(lamp.radiance) * mm_beam(lamp, wi) : color(0);
}

// What a table sends on of light from a direction of this density, with the balance heuristic against a mirror that is
// drawn by the sampler and followed as often as `chance` says.
color mm_sent_on(
    MMSampler sampler, MMViewer viewer, MMTable table, MMGrid grid, MMFrame frame, float chance, vector local,
    float density, color radiance, float slice, float gloss)
{
  float spread;
  vector stored = mm_in_table(local, frame.wo, gloss, spread);
  if (stored[2] <= 0)
    return 0;
  float shared = density + chance * mm_density(sampler, viewer, stored, frame.wo) * spread;
  return mm_lookup(table, grid, stored, frame.wo, slice) * radiance * (stored[2] * spread / shared);
}

// Light of the lamps reflected to the viewer.
color mm_lamp_light(
    MMLamp lamps[MM_MOST_LAMPS], int count, int points, MMSampler sampler, MMViewer viewer, MMTable table, MMGrid grid,
    MMFrame frame, point position, float chance, float u1, float u2, float slice, float gloss)
{
  color sum = 0;
  for (int k = 0; k < count; ++k) {
    MMAim aim = mm_lamp_seen(lamps[k], position);
    if (mm_expected_light(aim, frame.n, lamps[k].facts[1]) <= 0)
      continue;
    for (int j = 0; j < points; ++j) {
      vector wi;
      float density;
      color radiance = mm_point_of(lamps[k], aim, points, j, u1, u2, wi, density);
      vector local = mm_to_local(frame, wi);
      if (local[2] <= 0 || dot(wi, Ng) <= 0 || radiance == color(0) || !mm_visible(lamps[k], aim, position, wi))
        continue;
      sum += mm_sent_on(sampler, viewer, table, grid, frame, chance, local, density, radiance, slice, gloss);
    }
  }
  return sum;
}

// Light of a lamp that a direction of the sampler meets, and the part of it that mm_lamp_light has counted already.
color mm_light_along(MMLamp lamp, int points, point position, vector wi, float density, output float part)
{
  MMAim aim = mm_lamp_seen(lamp, position);
  float towards = points * mm_density_towards(aim, wi, 0);
  part = 0;
  if (towards <= 0 || !mm_visible(lamp, aim, position, wi))
    return 0;
  part = towards / (towards + density);
  return color(lamp.radiance) * mm_beam(lamp, wi);
}

// The same of all lamps, and what is counted of it; both are 0 where it meets none.
color mm_met_light(
    MMLamp lamps[MM_MOST_LAMPS], int count, int points, point position, vector wi, float density, output color counted)
{
  color all = 0;
  counted = 0;
  for (int k = 0; k < count; ++k) {
    float part;
    color light = mm_light_along(lamps[k], points, position, wi, density, part);
    all += light;
    counted += light * part;
  }
  return all;
}

// Whether a direction leaves the scene, on the side of the surface proper on which it is drawn, as of a mirror.
int mm_leaves(float side, point position, vector wi)
{
  return side * dot(wi, Ng) > 0 && !trace(position, wi, "maxdist", MM_ENDLESS);
}

int mm_leaves(point position, vector wi)
{
  return mm_leaves(1, position, wi);
}

// Light that a table reflects from a direction drawn towards the world with this density; nothing where something stands
// before the world.
color mm_world_light(
    MMSampler sampler, MMViewer viewer, MMTable table, MMGrid grid, MMFrame frame, point position, float chance,
    vector wi, float density, color radiance, float slice, float gloss)
{
  vector local = mm_to_local(frame, wi);
  if (local[2] <= 0 || density <= 0 || !mm_leaves(position, wi))
    return 0;
  return mm_sent_on(sampler, viewer, table, grid, frame, chance, local, density, radiance, slice, gloss);
}

// nodes/sampled_closure.py: how often the mirror's ray is followed past a lamp, for what is seen behind it. Cycles ends
// paths at random once they have bounced or passed something transparent: then never, or, past a lamp that is not much
// brighter than the sky, always and beside the closures, for which -1 stands.
// To a world whose light is known it is followed hardly ever: all the same then, were the table out of date.
float mm_followed(color lamp, float sky, int to_world)
{
  int depth = 0;
  int transparent = 0;
  getattribute("path:ray_depth", depth);
  getattribute("path:transparent_depth", transparent);
  if (to_world)
    return depth + transparent > 0 ? 0 : MM_LEAST_FOLLOWED;
  float bright = luminance(lamp);
  float background = sky / M_PI;
  if (depth + transparent > 0)
    return bright < background * MM_FAR_BRIGHTER ? -1 : 0;
  float behind = bright * MM_BEHIND + background;
  return max(behind / (behind + bright), MM_LEAST_FOLLOWED);
}

#endif
