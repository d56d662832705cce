// A side of a sheet, what it reflects and what comes through (method.md, sections 7 and 10): twins of
// nodes/sheet_group.py and nodes/sampled_sheet.py.

#ifndef MEASURED_SHEET_H
#define MEASURED_SHEET_H

#include "measured_parameters.h"
#include "measured_direct.h"

#define MM_LEAST_SIDE 0.1 // of nodes/sheet_group.py and nodes/sampled_sheet.py: _LEAST
#define MM_BY_DIFFUSE 2   // bake/sampling/lamp_light.py: which rays meet a light
#define MM_BY_TRANSMISSION 4

// What a side reflects, or lets through: tables and closures, of which there may be none. Its table's image and its
// closures' are then empty.
struct MMPart {
  MMSampler sampler;
  MMTable table;
  MMGrid grid;
  MMSampler shares;
  MMClosures envelope;
  MMClosures preview;
};

#define MM_PART_PARAMETERS(P)                                                                                          \
  MM_TABLE_PARAMETERS(P),                                                                                              \
  MM_SAMPLER_PARAMETERS(P),                                                                                            \
  MM_SHARE_PARAMETERS(P),                                                                                              \
  MM_CLOSURE_PARAMETERS(P##Envelope, "Envelope",                                                                       \
      "Weights of the closures under the table, in alpha the residual's share"),                                       \
  MM_CLOSURE_PARAMETERS(P##Preview, "Preview", "Weights of the closures that stand for the table"),                    \
  vector P##Direction = vector(0) [[ string label = "Direction", string help = "Of measured_aim.osl" ]],               \
  vector P##Densities = vector(0) [[ string label = "Densities", string help = "The same" ]],                          \
  color P##WorldTexel = 0 [[ string label = "World Texel", string help = "Of the world's table at that direction" ]],  \
  color P##Around = 0 [[ string label = "Around", string help = "The world's picture there" ]]

#define MM_PART(P, GLOSS)                                                                                              \
  {MM_SAMPLER(P), MM_TABLE(P), MM_GRID(P), MM_SHARES(P), MM_CLOSURES(P##Envelope, GLOSS), MM_CLOSURES(P##Preview, GLOSS)}

// A direction of measured_aim.osl.
struct MMDrawn {
  vector direction;
  vector densities;
  color texel;
};

// A mirror's direction: what the table sends along it over its density, which is `of_table` by the sampler alone.
struct MMAhead {
  vector wi_world;
  color weight;
  float of_table;
};

// What is to be lit: how often a part's mirror is drawn of the two, and how often one is followed beside the closures.
struct MMChances {
  float drawn;
  float followed;
};

// The closures of a part, or none, times a colour.
closure color mm_closures_of(MMClosures closures, MMFrame frame, normal n, float saturation, color factor)
{
  closure color sum = 0;
  if (closures.image != "") {
    float unused;
    sum = mm_weighted_closures(closures, mm_first_weight(closures, frame.wo, unused), frame, n, saturation, factor);
  }
  return sum;
}

// Of the light of a part, that which its mirror carries; 0 where it has none.
float mm_share_of(MMPart part, vector wo)
{
  float share = 0;
  if (part.table.image != "" && part.envelope.image != "")
    mm_first_weight(part.envelope, wo, share);
  return share;
}

// nodes/sheet_group.py: _mirror_chance, of a mirror that is aimed where `lamps` are
float mm_part_chance(
    MMPart part, MMFrame frame, float share, vector incoming, point position, vector centre, float lamps,
    float strength, float sky, float gloss)
{
  float usual = mm_mirror_probability(share);
  if (part.shares.image == "" || lamps <= 0)
    return usual;
  vector to_centre = centre - vector(position);
  if (dot(to_centre, frame.n) <= 0)
    return usual;
  // As the table has it, mirrored in the sheet.
  MMFrame above = frame;
  if (frame.side < 0) {
    to_centre -= 2 * dot(to_centre, frame.n) * frame.n;
    above.n = -frame.n;
  }
  return mm_lamp_probability(
      part.shares, above, usual, incoming, position, vector(position) + to_centre, lamps, strength, sky, gloss);
}

// nodes/lamp_share_group.py: lamp_side
float mm_lamp_side(float usual, vector n, point position, vector centre, float lamps, float strength, float sky)
{
  vector to_centre = centre - vector(position);
  float arriving = strength / dot(to_centre, to_centre);
  if (lamps <= 0 || arriving <= 0)
    return usual;
  float part = arriving / (arriving * lamps + arriving * MM_BOUNCED + sky);
  return clamp(mix(usual, dot(to_centre, n) > 0, part), MM_LEAST_SIDE, 1 - MM_LEAST_SIDE);
}

// nodes/sampled_closure.py: draw_ahead. `aimed` says that the direction is that of measured_aim.osl.
MMAhead mm_ahead(
    MMPart part, MMViewer viewer, MMFrame frame, int aimed, MMDrawn drawn, float xi[9], float gloss)
{
  MMAhead ahead;
  float pdf, spread;
  vector wi, seen;
  if (aimed) {
    ahead.wi_world = drawn.direction;
    seen = mm_to_local(frame, ahead.wi_world);
    wi = mm_in_table(seen, frame.wo, gloss, spread);
    ahead.of_table = mm_density(part.sampler, viewer, wi, frame.wo);
    pdf = mm_whole_density(drawn.densities / vector(spread, spread, 1), drawn.texel, ahead.of_table);
  }
  else {
    wi = mm_draw(part.sampler, viewer, frame.wo, xi[0], xi[1], xi[2], xi[3], pdf);
    seen = mm_seen(wi, frame.wo, gloss, spread);
    ahead.wi_world = mm_to_world(frame, seen);
    ahead.of_table = pdf;
  }
  ahead.of_table *= spread;
  ahead.weight = 0;
  if (wi[2] > 0 && seen[2] > 0)
    ahead.weight = mm_lookup(part.table, part.grid, wi, frame.wo, xi[4]) * (wi[2] / pdf);
  return ahead;
}

closure color mm_led(MMFrame frame, point position, vector wi, vector incoming, color weight)
{
  if (frame.side > 0)
    return mm_mirror(wi, incoming, weight);
  return mm_through(position, wi, incoming, weight);
}

// nodes/lamp_light_groups.py: light_side_group. `known` says that the world's light is.
float mm_light_side(
    MMLamp lamps[MM_MOST_LAMPS], int count, vector sky, vector world, int known, point position, vector n, float front)
{
  float above = sky[0] * front;
  float total = sky[0];
  for (int k = 0; k < count; ++k) {
    MMAim aim = mm_lamp_seen(lamps[k], position);
    float light = mm_expected_light_on_sheet(aim, n, lamps[k].facts[1], front);
    total += light;
    if (dot(aim.axis, n) > 0)
      above += light;
  }
  if (known) {
    above += mm_expected_world_light(world, sky[2], n) * front;
    total += mm_expected_world_light_on_sheet(world, sky[2], n, front);
  }
  return clamp(total > 0 ? above / total : front, MM_LEAST_SIDE, 1 - MM_LEAST_SIDE);
}

// nodes/lamp_light_groups.py: _met_by. Whether the ray that leads along wi meets a light of such rays: of a mirror always.
int mm_is_met(float rays, MMFrame frame, vector wi, vector incoming)
{
  if (frame.side > 0)
    return 1;
  int kinds = int(rays + 0.5);
  int transmission = (kinds & MM_BY_TRANSMISSION) != 0;
  if (dot(incoming, wi) < -1 / MM_INDEX - 1e-4)
    return transmission;
  if (raytype("camera"))
    return kinds & 1;
  int met = 1;
  if (raytype("diffuse"))
    met = (kinds & MM_BY_DIFFUSE) != 0;
  if (raytype("refraction"))
    met = met && transmission;
  return met;
}

// nodes/sampled_sheet.py: _mirrored. A part's mirror; how often closures are there beside it; and what is shown of the
// light that it meets. `aims` says that it was aimed at what cannot be sampled, `faint` that its weight may be small.
closure color mm_mirrored(
    MMAhead ahead, MMFrame frame, MMChances chances, int aims, int faint, MMLamp lamps[MM_MOST_LAMPS], int count,
    int points, float lit, color around, float world_density, float world_rays, float sky, point position,
    vector incoming, float number, float random, color gain, output float of_closures, output color shown)
{
  color weight = ahead.weight / chances.drawn;
  float density = chances.drawn * ahead.of_table;
  color every = 0;
  color counted = 0;
  color brought = 0;
  int to_world = 0;
  // What carries nothing is not traced, and puts no closure out.
  if (ahead.weight != color(0) && frame.side * dot(ahead.wi_world, Ng) > 0) {
    for (int k = 0; k < count; ++k) {
      float part;
      color light = mm_light_along(lamps[k], points, position, ahead.wi_world, density, part);
      every += light;
      counted += light * part;
      if (mm_is_met(lamps[k].rays, frame, ahead.wi_world, incoming))
        brought += light;
    }
    if (lit > 0 && mm_leaves(frame.side, position, ahead.wi_world)) {
      color light = max(around * lit, color(0));
      to_world = 1;
      every += light;
      counted += light * (world_density / (world_density + density));
      if (mm_is_met(world_rays, frame, ahead.wi_world, incoming))
        brought += light;
    }
  }
  float of_mirror = 1;
  of_closures = 1;
  float followed = chances.followed;
  int apart = aims;
  if (!aims && brought != color(0)) {
    followed = mm_followed(brought, sky, to_world);
    apart = followed >= 0;
  }
  if (apart) {
    int mirrored = number < followed;
    of_mirror = mirrored ? 1 / followed : 0;
    of_closures = mirrored ? 0 : 1 / (1 - followed);
  }
  shown = weight * (every - brought * of_mirror - counted);
  color carried = weight * gain * of_mirror;
  if (faint)
    carried = mm_roulette(carried, random);
  return mm_led(frame, position, ahead.wi_world, incoming, carried);
}

#endif
