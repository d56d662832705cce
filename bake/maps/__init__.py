"""Normal, albedo, height and roughness maps of a swatch that was photographed under lights of many directions."""
