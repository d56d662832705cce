"""Bundles: folders of images and one JSON document."""
