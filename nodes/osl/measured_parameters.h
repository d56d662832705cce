// Parameters that several of the OSL shaders take, as lists to be put among a shader's own, and the structs of them. P is
// put before their names: a sheet has those of what it reflects, without one, and those of what it lets through.

#ifndef MEASURED_PARAMETERS_H
#define MEASURED_PARAMETERS_H

#include "measured_lamps.h"

#define MM_TABLE_PARAMETERS(P)                                                                                         \
  string P##Table = "" [[ string label = "Table", string widget = "filename",                                          \
      string help = "Atlas of the samples; in a material of the BRDF in mode reference, else of the residual" ]],      \
  float P##Scale = 1 [[ string label = "Scale", string help = "What stored values are multiplied by" ]],               \
  float P##Offset = 0 [[ string label = "Offset", string help = "What is subtracted from stored values before" ]],     \
  vector P##LogRange = vector(0) [[ string label = "Log Range",                                                        \
      string help = "Of stored codes, by channel; 0 where values are stored" ]],                                       \
  vector P##LogGain = vector(0) [[ string label = "Log Gain", string help = "Factor of what the codes stand for" ]],   \
  string P##Basis = "normal" [[ string label = "Basis",                                                                \
      string help = "normal, half, half cosine, half squared or patches" ]],                                           \
  int P##Azimuths = 0 [[ string label = "Azimuths",                                                                    \
      string help = "Samples of the azimuth that chooses slices too; 0 of an isotropic table" ]],                      \
  int P##Slices = 64 [[ string label = "Slices", string help = "Samples of theta_o or theta_d" ]],                     \
  int P##SliceRows = 64 [[ string label = "Slice Rows",                                                                \
      string help = "Samples of theta_i, theta_h or the half vector's slope across the tangent" ]],                    \
  int P##SliceColumns = 128 [[ string label = "Slice Columns",                                                         \
      string help = "Samples of phi_delta, phi_d or the half vector's slope along the tangent" ]],                     \
  int P##Columns = 6 [[ string label = "Columns", string help = "Slices side by side in the atlas" ]],                 \
  int P##Rows = 11 [[ string label = "Rows", string help = "Slices one below the other in the atlas" ]],               \
  string P##Parameterization = "bezier" [[ string label = "Parameterization",                                          \
      string help = "identity, uniform, bezier, squared or fitted" ]],                                                 \
  vector P##ShapeSlice = vector(0.5, 0, 0) [[ string label = "Shape Slice",                                            \
      string help = "Of the axis across slices: Bezier alpha, or the constants of a fitted warp" ]],                   \
  vector P##ShapeRow = vector(0.5, 0, 0) [[ string label = "Shape Row",                                                \
      string help = "The same, of rows; of slopes their width" ]],                                                     \
  vector P##ShapePhi = vector(0.5, 0, 0) [[ string label = "Shape Phi",                                                \
      string help = "The same, of columns" ]],                                                                         \
  int P##Reciprocal = 0 [[ string label = "Reciprocal", string widget = "checkBox",                                    \
      string help = "phi_d ends at pi / 2" ]],                                                                         \
  int P##Folded = 0 [[ string label = "Folded", string widget = "checkBox",                                            \
      string help = "Azimuths of half a turn" ]],                                                                      \
  string P##Filter = "trilinear" [[ string label = "Filter", string help = "nearest, trilinear or bspline" ]],         \
  int P##Stochastic = 0 [[ string label = "Stochastic", string widget = "checkBox",                                    \
      string help = "One slice by the filter's weights, unbiased, rather than a blend of all" ]]

#define MM_GRID(P)                                                                                                     \
  {P##Basis, P##Parameterization, P##Azimuths, P##Slices, P##SliceRows, P##SliceColumns, P##ShapeSlice,                \
   P##ShapeRow, P##ShapePhi, P##Reciprocal, P##Folded}
#define MM_TABLE(P)                                                                                                    \
  {P##Table, P##Scale, P##Offset, P##LogRange, P##LogGain, P##Columns, P##Rows, P##Filter, P##Stochastic, 1}

#define MM_SAMPLER_PARAMETERS(P)                                                                                       \
  string P##Sampler = "" [[ string label = "Sampler", string help = "Warp or alias tables", string widget = "filename" ]], \
  int P##Bins = 64 [[ string label = "Bins", string help = "Of the viewer's elevation" ]],                             \
  int P##BinsPhi = 0 [[ string label = "Bins Phi",                                                                     \
      string help = "Of the viewer's azimuth; 0 of an isotropic table" ]],                                             \
  int P##CellRows = 64 [[ string label = "Cell Rows",                                                                  \
      string help = "Of the half vector's elevation, or of its slope across the tangent" ]],                           \
  int P##CellColumns = 32 [[ string label = "Cell Columns",                                                            \
      string help = "Of the half vector's azimuth, or of its slope along the tangent" ]],                              \
  int P##Warp = 2 [[ string label = "Warp", string help = "Power of the elevations' edges" ]],                         \
  float P##WidthX = 0.3 [[ string label = "Width X", string help = "Slope in the middle of the columns" ]],            \
  float P##WidthY = 0.3 [[ string label = "Width Y", string help = "Slope in the middle of the rows" ]],               \
  int P##HalfTurn = 0 [[ string label = "Half Turn", string widget = "checkBox",                                       \
      string help = "Viewers after half a turn share their cells" ]],                                                  \
  int P##Strata = 0 [[ string label = "Strata", string help = "Of a warp's first number; 0 of alias tables" ]],        \
  float P##Linear = 1 [[ string label = "Linear", string help = "Width of a warp's elevations" ]],                     \
  float P##Concentration = 0 [[ string label = "Concentration",                                                        \
      string help = "Mean density of its own draws: how narrow their lobes are, where lamps are aimed at" ]]

#define MM_SAMPLER(P)                                                                                                  \
  {P##Sampler, P##Bins, P##BinsPhi, P##CellRows, P##CellColumns, P##Warp, P##WidthX, P##WidthY, P##HalfTurn,           \
   P##Strata, P##Linear}

#define MM_SHARE_PARAMETERS(P)                                                                                         \
  string P##Shares = "" [[ string label = "Shares", string widget = "filename",                                        \
      string help = "The residual's share of one lamp's light" ]],                                                     \
  int P##ShareBins = 8 [[ string label = "Share Bins", string help = "Slices of the viewer's elevation" ]],            \
  int P##ShareBinsPhi = 0 [[ string label = "Share Bins Phi",                                                          \
      string help = "Slices of the viewer's azimuth; 0 of an isotropic table" ]],                                      \
  int P##ShareCellRows = 16 [[ string label = "Share Rows",                                                            \
      string help = "Of cos theta_d, or of the half vector's slope across the tangent" ]],                             \
  int P##ShareCellColumns = 16 [[ string label = "Share Columns",                                                      \
      string help = "Of theta_h, or of the half vector's slope along the tangent" ]],                                  \
  float P##ShareWidthX = 0.3 [[ string label = "Share Width X", string help = "Slope halfway along the columns" ]],    \
  float P##ShareWidthY = 0.3 [[ string label = "Share Width Y", string help = "Slope halfway along the rows" ]],       \
  int P##ShareHalfTurn = 0 [[ string label = "Share Half Turn", string widget = "checkBox",                            \
      string help = "Viewers after half a turn share their slices" ]]

#define MM_SHARES(P)                                                                                                   \
  {P##Shares, P##ShareBins, P##ShareBinsPhi, P##ShareCellRows, P##ShareCellColumns, 0, P##ShareWidthX,                 \
   P##ShareWidthY, P##ShareHalfTurn, 0, 1}

#define MM_CLOSURE_PARAMETERS(NAME, LABEL, HELP)                                                                       \
  string NAME = "" [[ string label = LABEL, string widget = "filename", string help = HELP ]],                         \
  int NAME##Nodes = 64 [[ string label = LABEL " Nodes", string help = "Viewer's elevations, texels across" ]],        \
  int NAME##Azimuths = 0 [[ string label = LABEL " Azimuths",                                                          \
      string help = "Viewer's azimuths; 0 of an isotropic material" ]],                                                \
  int NAME##HalfTurn = 0 [[ string label = LABEL " Half Turn", string widget = "checkBox",                             \
      string help = "Viewers after half a turn share their weights" ]],                                                \
  string NAME##Closures = "" [[ string label = LABEL " Closures",                                                      \
      string help = "Name and widths along and across of each: lambert 0 0 ggx 0.1 0.3" ]]

#define MM_CLOSURES(NAME, GLOSS) {NAME, NAME##Nodes, NAME##Azimuths, NAME##HalfTurn, NAME##Closures, GLOSS}

#define MM_LAMP_PARAMETERS(K)                                                                                          \
  vector Centre##K = vector(0) [[ string label = "Centre " #K, string help = "Of the lamp" ]],                         \
  vector U##K = vector(0) [[ string label = "U " #K, string help = "Edge or diameter" ]],                              \
  vector V##K = vector(0) [[ string label = "V " #K, string help = "The same, across" ]],                              \
  vector Axis##K = vector(0) [[ string label = "Axis " #K, string help = "Emission, or towards the sun" ]],            \
  vector Facts##K = vector(0) [[ string label = "Facts " #K, string help = "Kind, power and extent" ]],                \
  vector Radiance##K = vector(0) [[ string label = "Radiance " #K, string help = "Along its axis, by channel" ]],      \
  vector Beam##K = vector(0) [[ string label = "Beam " #K, string help = "Kind of its fall-off, where and how steep" ]], \
  float Facing##K = 0 [[ string label = "Facing " #K, string help = "1 of a disk that faces whoever looks at it" ]],    \
  float Rays##K = 0 [[ string label = "Rays " #K, string help = "Which rays meet it, as the table of lights has it" ]]

#define MM_LAMP(K) {Centre##K, U##K, V##K, Axis##K, Facts##K, Radiance##K, Beam##K, Facing##K, Rays##K}

#endif
