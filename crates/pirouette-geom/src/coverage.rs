//! Antialiased coverage of polygons and projected meshes.
