"""The areas of a site: polygons with heights, their files, their volumes. Pure but for reading files."""
