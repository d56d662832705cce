// Aiming at the scene's lamps: twin of bake/sampling/lamps.py and nodes/aimed_light_group.py, which say why.

#ifndef MEASURED_LAMPS_H
#define MEASURED_LAMPS_H

#include "measured_materials.h"
#include "measured_world.h"

#define MM_MOST_LAMPS 4 // nodes/aimed_light_group.py: MAX_SLOTS
#define MM_ELLIPSE 1
#define MM_SPHERE 2
#define MM_SUN 3
#define MM_LEAST_COSINE 0.05
#define MM_LEAST_AIMED 0.5
#define MM_LOBES_ACROSS 10.0

// One row of the tables of lamps; facts are kind, power, and area^-1, radius or 1 - cos of the half angle. The last four
// are of bake/sampling/lamp_light.py.
struct MMLamp {
  vector centre;
  vector u;
  vector v;
  vector axis;
  vector facts;
  vector radiance;
  vector beam;
  float facing;
  float rays;
};

// A lamp as seen from a point.
struct MMAim {
  float kind;
  vector u;
  vector v;
  vector emission;
  float fourth;
  vector to_centre;
  vector axis;
  float m;
};

MMAim mm_aim_at(MMLamp lamp, point position)
{
  MMAim aim;
  aim.kind = lamp.facts[0];
  aim.fourth = lamp.facts[2];
  aim.u = lamp.u;
  aim.v = lamp.v;
  aim.emission = lamp.axis;
  aim.to_centre = lamp.centre - vector(position);
  if (aim.kind > MM_SUN - 0.5) {
    aim.m = aim.fourth;
    aim.axis = lamp.axis;
  }
  else {
    // From inside a sphere every direction meets it: m = 2.
    float ratio = aim.fourth * aim.fourth / dot(aim.to_centre, aim.to_centre);
    aim.m = ratio < 1 ? ratio / (1 + sqrt(1 - ratio)) : 2.0;
    aim.axis = normalize(aim.to_centre);
  }
  return aim;
}

vector mm_draw_towards(MMAim aim, float u1, float u2)
{
  float angle = u2 * M_2PI;
  if (aim.kind > MM_SPHERE - 0.5) {
    // A little inside the edge, where rounding decides whether the ray meets the lamp.
    float lean = aim.m * u1 * 0.99999;
    float across = sqrt(lean * (2 - lean));
    vector helper = aim.axis[0] * aim.axis[0] > 0.5 ? vector(0, 1, 0) : vector(1, 0, 0);
    vector first = normalize(cross(aim.axis, helper));
    vector second = cross(aim.axis, first);
    return (1 - lean) * aim.axis + across * cos(angle) * first + across * sin(angle) * second;
  }
  float s = u1 - 0.5;
  float t = u2 - 0.5;
  if (aim.kind > MM_ELLIPSE - 0.5) {
    s = 0.5 * sqrt(u1) * cos(angle);
    t = 0.5 * sqrt(u1) * sin(angle);
  }
  return normalize(aim.to_centre + s * aim.u + t * aim.v);
}

// `drawn` is 1 where wi was drawn towards this lamp: then it meets it, whatever rounding says.
float mm_density_towards(MMAim aim, vector wi, int drawn)
{
  if (aim.kind > MM_SPHERE - 0.5) {
    vector apart = wi - aim.axis;
    return (drawn || dot(apart, apart) < 2 * aim.m) ? 1 / (M_2PI * aim.m) : 0.0;
  }
  float facing = dot(aim.emission, wi);
  float distance = dot(aim.emission, aim.to_centre) / facing;
  if (facing >= 0 || distance <= 0)
    return 0.0;
  vector hit = wi * distance - aim.to_centre;
  float s = dot(hit, aim.u) / dot(aim.u, aim.u);
  float t = dot(hit, aim.v) / dot(aim.v, aim.v);
  float reach = aim.kind > MM_ELLIPSE - 0.5 ? sqrt(s * s + t * t) : max(abs(s), abs(t));
  return (drawn || reach < 0.5) ? distance * distance * aim.fourth / max(-facing, 1e-12) : 0.0;
}

// _face_to_face
float mm_face_to_face(MMAim aim, float power)
{
  float distance2 = dot(aim.to_centre, aim.to_centre);
  float facing = 1;
  float near2 = aim.fourth * aim.fourth;
  if (aim.kind < MM_SPHERE - 0.5) {
    float shone = -dot(aim.emission, aim.to_centre);
    facing = shone > 0 ? max(shone / sqrt(distance2), MM_LEAST_COSINE) : 0.0;
    near2 = 0.25 / aim.fourth;
  }
  float falloff = aim.kind > MM_SUN - 0.5 ? 1.0 : 1 / max(max(distance2, near2), 1e-12);
  return facing * falloff * power;
}

float mm_expected_light(MMAim aim, vector n, float power)
{
  float leaning = dot(aim.axis, n);
  int reaches;
  if (aim.kind > MM_SPHERE - 0.5)
    reaches = leaning + sqrt(max(aim.m * (2 - aim.m), 0.0)) > 0 || aim.m > 1;
  else
    reaches = dot(aim.to_centre, n) + 0.5 * (abs(dot(aim.u, n)) + abs(dot(aim.v, n))) > 0;
  return reaches ? max(leaning, MM_LEAST_COSINE) * mm_face_to_face(aim, power) : 0.0;
}

// expected_light_on_sheet
float mm_expected_light_on_sheet(MMAim aim, vector n, float power, float front)
{
  float leaning = dot(aim.axis, n);
  float side = leaning > 0 ? front : 1 - front;
  return max(side, MM_LEAST_COSINE) * max(abs(leaning), MM_LEAST_COSINE) * mm_face_to_face(aim, power);
}

// aimed_part
float mm_aimed_part(MMAim aim, float concentration)
{
  float solid_angle = M_2PI * aim.m;
  if (aim.kind < MM_SPHERE - 0.5) {
    float distance2 = dot(aim.to_centre, aim.to_centre);
    float shone = max(-dot(aim.emission, aim.to_centre), 0.0);
    solid_angle = shone / sqrt(distance2) / max(distance2 * aim.fourth, 0.25);
  }
  return MM_LEAST_AIMED + (1 - MM_LEAST_AIMED) / (1 + concentration * solid_angle / MM_LOBES_ACROSS);
}

#define MM_BOUNCED 0.1 // bake/envelope/lamp_share.py

// bake/envelope/lamp_share.py: ShareLayout.shape, and share_coordinates from the left and from below
void mm_share_place(
    MMSampler layout, vector wo, vector n, vector to_lamp, vector incoming, output float s, output float t)
{
  vector half_vector = normalize(to_lamp + incoming);
  float along = sqrt(length(half_vector - n) * M_SQRT1_2);
  float slice = floor(mm_chord(wo, vector(0, 0, 1)) * (layout.bins * 0.99999));
  float width = layout.bins * layout.cell_columns;
  s = slice / layout.bins + (along * (layout.cell_columns - 1) + 0.5) / width;
  t = (dot(half_vector, to_lamp) * (layout.cell_rows - 1) + 0.5) / layout.cell_rows;
}

// bake/envelope/lamp_share.py: SlopeShareLayout.coordinates; wi and wo local
void mm_slope_share_place(MMSampler layout, vector wi, vector wo, output float s, output float t)
{
  MMHalf h;
  float u;
  float v;
  mm_warped_slopes(layout, wi, wo, h, u, v);
  float bin = mm_viewer_bin(layout, wo);
  float elevation = floor((bin + 0.5) / layout.bins_phi);
  float azimuth = bin - elevation * layout.bins_phi;
  float across = elevation * layout.cell_columns + (0.5 + 0.5 * u) * (layout.cell_columns - 1) + 0.5;
  float up = azimuth * layout.cell_rows + (0.5 + 0.5 * v) * (layout.cell_rows - 1) + 0.5;
  s = across / (layout.bins * layout.cell_columns);
  t = up / (layout.bins_phi * layout.cell_rows);
}

// bake/envelope/lamp_share.py and nodes/lamp_share_group.py: the mirror's probability, by the residual's share of light
// from `centre`, whose irradiance at distance 1 is `strength`, and by the usual share of all other, with `lamps` as
// bright as this one and `sky` beside. The shares' slices and nodes are described as a sampler's bins and cells are.
float mm_lamp_probability(
    MMSampler shares, MMFrame frame, float usual, vector incoming, point position, vector centre, float lamps,
    float strength, float sky, float gloss)
{
  vector to_centre = centre - vector(position);
  vector to_lamp = normalize(to_centre);
  float arriving = strength / dot(to_centre, to_centre);
  if (arriving <= 0)
    return usual;
  float spread;
  to_lamp = mm_stretched(to_lamp, incoming, frame.n, gloss, spread);
  float s;
  float t;
  if (shares.bins_phi == 0)
    mm_share_place(shares, frame.wo, frame.n, to_lamp, incoming, s, t);
  else
    mm_slope_share_place(shares, mm_to_local(frame, to_lamp), frame.wo, s, t);
  float alpha;
  color seen = mm_tap(shares.image, s, 1 - t, "linear", alpha);
  float light = arriving * seen[1];
  return mix(usual, seen[0], light / (light * lamps + arriving * MM_BOUNCED + sky));
}

// Exchange wi for a direction towards a lamp or the bright parts of the world, now and then. Of a sampler of density p, the
// whole density of the direction returned is aimed + of_world q + rest p, q the world's own. Sky is the irradiance of all
// that is not aimed at, the largest share of aimed draws, and the flux of the world's structure, 0 where it is not aimed
// at; toward is where that comes from. Concentration is the sampler's, bake/sampling/concentration.py.
vector mm_aim(
    MMLamp lamps[MM_MOST_LAMPS], int count, vector sky, vector toward, MMWorldCell cell, float concentration,
    point position, vector n, vector wi, float u_lamp, float u_aim, float u1, float u2, output float aimed, output float of_world,
    output float rest)
{
  MMAim aims[MM_MOST_LAMPS];
  float wanted[MM_MOST_LAMPS];
  float total = 0;
  float aiming = 0;
  for (int k = 0; k < count; ++k) {
    MMAim aim = mm_aim_at(lamps[k], position);
    aims[k] = aim;
    float light = mm_expected_light(aim, n, lamps[k].facts[1]);
    wanted[k] = light * mm_aimed_part(aim, concentration);
    total += light;
    aiming += wanted[k];
  }
  float world = mm_expected_world_light(toward, sky[2], n);
  total += world;
  aiming += world;
  float share = min(total / (total + sky[0]), sky[1] * aiming / total);
  vector chosen = wi;
  int target = -1;
  if (u_aim < share) {
    // Which light: how many of the running sums the number has passed. The world comes last.
    float passed = 0;
    target = 0;
    for (int k = 0; k < count; ++k) {
      passed += wanted[k];
      target += u_lamp * aiming > passed && (world > 0 || k < count - 1);
    }
    if (target < count)
      chosen = mm_draw_towards(aims[target], u1, u2);
    else
      // Below the share u_aim is even from 0 to it: it may decide about the alias too.
      chosen = mm_draw_in_world(cell, u_aim < share * cell.acceptance, u1, u2);
  }
  float density = 0;
  for (int k = 0; k < count; ++k)
    if (wanted[k] > 0)
      density += wanted[k] * mm_density_towards(aims[k], chosen, k == target);
  aimed = density * share / aiming;
  of_world = world * share / aiming;
  rest = 1 - share;
  return chosen;
}

#endif
