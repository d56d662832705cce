// What the OSL shaders of Measured Materials share: hand-written twins of formulas in bake/ and nodes/, each named
// beside its function. Directions are unit vectors; "local" is the frame (t, b, n) with z = n; I points to the viewer.

#ifndef MEASURED_MATERIALS_H
#define MEASURED_MATERIALS_H

#include "stdcycles.h"
#include "measured_gloss.h"
#include "measured_warps.h"
#include "measured_tables.h"

#define MM_MIN_COSINE 1e-3   // nodes/local_frame_group.py
#define MM_LEAST_WEIGHT 2e-5 // above that of nodes/stochastic_mirror_group.py, where a metal carries most of these
#define MM_INDEX 50.0        // nodes/through_closure.py: IOR
#define MM_MARKER_WEIGHT 1e3 // nodes/surface_marker.py, as the next two
#define MM_MARKED_COSINE 0.02
#define MM_MATTE 1
#define MM_WORDS 36          // bake/envelope/texture.py: three for each of at most 12 closures
#define MM_USUAL 3           // how many there mostly are

// The shading normal, the viewer in its local frame, and the tangents. Of light that comes through a sheet n points to the
// far side and `side` is -1, else 1: local directions of the light are then mirrored in the sheet, as tables have them.
struct MMFrame {
  vector wo;
  vector tangent;
  vector bitangent;
  vector n;
  float side;
};

// Native closures, each a name and two widths, and the texture of their weights over `nodes` elevations of the viewer
// and, where there are any, `azimuths`. An artist's gloss divides the widths of GGX.
struct MMClosures {
  string image;
  int nodes;
  int azimuths;
  int half_turn;
  string words;
  float gloss;
};

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
  frame.side = 1;
  return frame;
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
  frame.side = 1;
  return frame;
}

// nodes/drawn_direction.py: drawn_direction of what comes through
MMFrame mm_below(MMFrame frame)
{
  MMFrame below = frame;
  below.n = -frame.n;
  below.side = -1;
  return below;
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

// nodes/lens_group.py: two numbers that place something are the camera's, where those are known.
void mm_by_lens(vector lens, output float first, output float second)
{
  if (lens[2] > 0) {
    first = lens[0];
    second = lens[1];
  }
}

// A number that chooses with this chance in place of another; what the choice leaves of it is even again.
void mm_choose_by_first(float chance, output float first, output float choice)
{
  choice = first;
  first = choice < chance ? choice / chance : (choice - chance) / (1 - chance);
}

// nodes/stochastic_mirror_group.py: mirror_closure, without the roulette
closure color mm_mirror(vector wi, vector incoming, color weight)
{
  return max(weight, color(0)) * microfacet("ggx", normalize(wi + incoming), vector(0), 0.0, 0.0, 0.0, 0);
}

// nodes/through_closure.py: through_closure, without the roulette. The closure, unlike the node, leaves the index of a back
// as it is.
closure color mm_through(point position, vector wi, vector incoming, color weight)
{
  color carried = max(weight, color(0));
  if (dot(incoming, wi) < -1 / MM_INDEX - 1e-4)
    return carried * microfacet("ggx", normalize(-(incoming + wi * MM_INDEX)), vector(0), 0.0, 0.0, MM_INDEX, 1);
  return carried * ray_portal_bsdf(position, wi);
}

// Weights that Cycles would drop live on by Russian roulette, raised as often as keeps their mean.
color mm_roulette(color weight, float random)
{
  float keep = min((weight[0] + weight[1] + weight[2]) / (3 * MM_LEAST_WEIGHT), 1.0);
  return random < keep ? weight / keep : color(0);
}

// nodes/surface_marker.py: how a ray asks for what Cycles' Normal pass (1) or its bakes (2) take for the surface; 0 if not.
int mm_asked(normal n, vector incoming, int normals)
{
  float distance = 0;
  getattribute("path:ray_length", distance);
  if (!raytype("camera") || dot(n, incoming) <= MM_MARKED_COSINE)
    return 0;
  return distance == 1 ? 2 : normals;
}

// nodes/surface_marker.py: it reflects nothing
closure color mm_surface_marker(normal n, float roughness)
{
  float alpha = roughness * roughness;
  return MM_MARKER_WEIGHT * dielectric_bsdf(n, vector(0), color(1), color(0), alpha, alpha, 1.0, "ggx");
}

// nodes/native_closure.py: `along` is alpha of "ggx", sigma of "sheen", roughness of "oren_nayar"; `across` is the alpha
// at right angles to a tangent, which is 0 where both are one.
closure color mm_native(string name, float along, float across, vector tangent, normal n, float gloss)
{
  if (name == "ggx") {
    // The node's Roughness, of which this is the square, ends at 1.
    float mean = across > 0 ? sqrt(along * across) : along;
    float factor = min(1 / gloss, 1 / mean);
    return microfacet("ggx", n, tangent, along * factor, across * factor, 0.0, 0);
  }
  if (name == "sheen")
    return ashikhmin_velvet(n, along);
  if (name == "translucent")
    return translucent(n);
  if (name == "oren_nayar" && along > 0)
    return oren_nayar_diffuse_bsdf(n, color(1), along);
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

// bake/envelope/texture.py: the texel of closure k of `count` for a viewer
color mm_closure_weight(MMClosures closures, int k, int count, vector wo, output float alpha)
{
  float t = (k + 0.5) / count;
  if (closures.azimuths > 0) {
    int rows = closures.azimuths + 2;
    float row = mm_azimuth_index(wo[0], wo[1], closures.azimuths, closures.half_turn) + k * rows + 1.5;
    t = row / (count * rows);
  }
  return mm_tap(closures.image, mm_weight_coordinate(wo, closures.nodes), t, "linear", alpha);
}

// nodes/surface_marker.py: mean_roughness, of a viewer at the normal
float mm_mean_roughness(MMClosures closures)
{
  string words[MM_WORDS];
  int count = split(closures.words, words, " ") / 3;
  float total = 0;
  float sum = 0;
  for (int k = 0; k < count; ++k) {
    string name = words[3 * k];
    if (name == "ggx" || name == "sheen") {
      float alpha;
      color weight = mm_closure_weight(closures, k, count, vector(0, 0, 1), alpha);
      float part = weight[0] + weight[1] + weight[2];
      float across = stof(words[3 * k + 2]);
      total += part * (name == "ggx" ? min(pow(stof(words[3 * k + 1]) * across, 0.25) / sqrt(closures.gloss), 1.0) : MM_MATTE);
      sum += part;
    }
  }
  return sum > 0 ? total / sum : MM_MATTE;
}

// nodes/weighted_closures.py: one of them, whose weight is `value`, saturated, times a colour
closure color mm_weighted_closure(
    MMClosures closures, string name, string along, string across, color value, vector tangent, normal n,
    float saturation, color factor)
{
  color weight = max(mm_saturated(value, saturation) * factor, color(0));
  return weight * mm_native(name, stof(along), stof(across), tangent, n, closures.gloss);
}

// Their sum; `first` is the texel of the first closure's weight.
closure color mm_weighted_closures(
    MMClosures closures, color first, MMFrame frame, normal n, float saturation, color factor)
{
  string words[MM_WORDS];
  int count = split(closures.words, words, " ") / 3;
  vector tangent = closures.azimuths > 0 ? frame.tangent : vector(0);
  float alpha;
  // The usual ones by constant places: OSL then splits and reads the words while it compiles, not for every sample.
  closure color sum =
      mm_weighted_closure(closures, words[0], words[1], words[2], first, tangent, n, saturation, factor);
  if (count > 1)
    sum += mm_weighted_closure(
        closures, words[3], words[4], words[5], mm_closure_weight(closures, 1, count, frame.wo, alpha), tangent, n,
        saturation, factor);
  if (count > 2)
    sum += mm_weighted_closure(
        closures, words[6], words[7], words[8], mm_closure_weight(closures, 2, count, frame.wo, alpha), tangent, n,
        saturation, factor);
  for (int k = MM_USUAL; k < count; ++k)
    sum += mm_weighted_closure(
        closures, words[3 * k], words[3 * k + 1], words[3 * k + 2],
        mm_closure_weight(closures, k, count, frame.wo, alpha), tangent, n, saturation, factor);
  return sum;
}

// The texel of the first closure's weight, in whose alpha the residual's share stands.
color mm_first_weight(MMClosures closures, vector wo, output float share)
{
  string words[MM_WORDS];
  return mm_closure_weight(closures, 0, split(closures.words, words, " ") / 3, wo, share);
}

#endif
