//! Phantom parts of a visual hull: regions that a few silhouettes cannot distinguish from the body.
//!
//! Where lines of sight through an arm in one view and the chest in another cross, a hull of eight views has flaps and
//! spikes that are not part of the person. The avatar's own hull from the same views has them in the same places, and
//! there the avatar shows which points belong to the body.

use glam::DVec3;
use pirouette_geom::parallel::prelude::*;

use super::{CarveError, CarveView, HullField, ViewSet};
use pirouette_body::Avatar;
use pirouette_body::render::SilhouetteMesh;
use pirouette_geom::outline_map::OutlineMap;

/// Only points farther than this from the avatar's surface can be phantoms, in mm
///
/// A hull of eight views is up to 10 mm larger than a round body everywhere. With 15 a person stouter than the avatar
/// would lose volume between the two surfaces.
const CLEARANCE_MM: f64 = 25.0;

/// Distance beyond the avatar's hull within which phantoms are searched, in mm: the person's own flaps are at slightly
/// different positions
const REACH_MM: f64 = 10.0;

/// Edge of the buckets that hold the avatar's vertices, in mm
const BUCKET_MM: f64 = 40.0;

/// Number of buckets to search in each direction: no point inside a body is farther than this from its surface
const SEARCH_RINGS: usize = 6;

/// Regions where an avatar's hull is much larger than the avatar
pub(super) struct PhantomField<'a> {
    pub(super) hull: HullField<'a>,
    surface: NearestVertex,
}

/// Renders the avatar's outlines for the cameras of `views`, at their turn angles
pub(super) fn outlines(views: &[CarveView], avatar: &Avatar) -> Vec<OutlineMap> {
    let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
    let outline = |view: &CarveView| {
        let room_from_world = view.turn.room_from_world();
        let positions = avatar.mesh.positions.iter();
        let positions: Vec<DVec3> = positions.map(|&p| room_from_world * p).collect();
        let silhouette = mesh.silhouette(&positions, &view.camera);
        OutlineMap::new(&silhouette, OutlineMap::FAR_PX)
    };
    views.par_iter().map(outline).collect()
}

impl<'a> PhantomField<'a> {
    /// Prepares the avatar's `outlines`, seen as in `views`
    pub(super) fn new(
        views: &[CarveView],
        outlines: &'a [OutlineMap],
        avatar: &Avatar,
    ) -> Result<Self, CarveError> {
        let seen: Vec<CarveView> = views
            .iter()
            .zip(outlines)
            .map(|(view, outline)| CarveView {
                outline,
                camera: view.camera,
                turn: view.turn,
            })
            .collect();
        Ok(Self {
            hull: HullField::new(&seen, 1)?,
            surface: NearestVertex::new(avatar),
        })
    }

    /// Returns a positive value, in mm, where a point of the person's hull is a phantom, by some of the avatar's views;
    /// never steeper than the hull's field
    pub(super) fn value(&self, point: DVec3, part: ViewSet) -> f64 {
        let inside_hull = REACH_MM - self.hull.value(point, part);
        if inside_hull <= 0.0 || inside_hull.is_nan() {
            return -inside_hull.abs();
        }
        inside_hull.min(self.surface.signed_distance(point) - CLEARANCE_MM)
    }
}

/// Finds the avatar's nearest vertex with a spatial grid of buckets
struct NearestVertex {
    low: DVec3,
    counts: [usize; 3],
    /// Vertices of bucket `b` are `vertices[starts[b]..starts[b + 1]]`
    starts: Vec<u32>,
    vertices: Vec<(DVec3, DVec3)>,
}

impl NearestVertex {
    fn new(avatar: &Avatar) -> Self {
        let (low, high) = avatar.mesh.bounds().unwrap_or((DVec3::ZERO, DVec3::ZERO));
        let counts = ((high - low) / BUCKET_MM)
            .to_array()
            .map(|n| n.max(0.0) as usize + 1);
        let mut field = Self {
            low,
            counts,
            starts: vec![0; counts.iter().product::<usize>() + 1],
            vertices: Vec::with_capacity(avatar.mesh.positions.len()),
        };
        let normals = avatar.mesh.vertex_normals();
        let mut sorted: Vec<(usize, DVec3, DVec3)> = avatar
            .mesh
            .positions
            .iter()
            .zip(normals)
            .map(|(&p, n)| (field.index(field.bucket(p)), p, n))
            .collect();
        sorted.sort_unstable_by_key(|&(bucket, ..)| bucket);
        for &(bucket, position, normal) in &sorted {
            field.starts[bucket + 1] += 1;
            field.vertices.push((position, normal));
        }
        for b in 1..field.starts.len() {
            field.starts[b] += field.starts[b - 1];
        }
        field
    }

    fn bucket(&self, point: DVec3) -> [usize; 3] {
        let local = ((point - self.low) / BUCKET_MM).to_array();
        std::array::from_fn(|k| (local[k].max(0.0) as usize).min(self.counts[k] - 1))
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.counts[0] * (y + self.counts[1] * z)
    }

    /// Returns the distance to the nearest vertex, negative behind its surface; far from all vertices, the search limit
    fn signed_distance(&self, point: DVec3) -> f64 {
        let mut nearest = (f64::INFINITY, 1.0);
        let center = self.bucket(point);
        for ring in 1..=SEARCH_RINGS {
            let range = |k: usize| {
                let c: usize = center[k];
                c.saturating_sub(ring)..=(c + ring).min(self.counts[k] - 1)
            };
            for z in range(2) {
                for y in range(1) {
                    for x in range(0) {
                        self.look_into([x, y, z], point, &mut nearest);
                    }
                }
            }
            // All vertices nearer than the width of the ring have been visited.
            if nearest.0 <= (ring as f64 * BUCKET_MM).powi(2) {
                break;
            }
        }
        let end = SEARCH_RINGS as f64 * BUCKET_MM;
        nearest.0.sqrt().min(end).copysign(nearest.1)
    }

    fn look_into(&self, bucket: [usize; 3], point: DVec3, nearest: &mut (f64, f64)) {
        let bucket = self.index(bucket);
        let held = self.starts[bucket] as usize..self.starts[bucket + 1] as usize;
        for &(position, normal) in &self.vertices[held] {
            let away = point - position;
            let distance = away.length_squared();
            if distance < nearest.0 {
                *nearest = (distance, away.dot(normal));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CarveOptions, carve, carve_beside_avatar};
    use super::*;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};
    use pirouette_body::render;
    use pirouette_synthetic::SyntheticOptions;

    /// Outlines of a body that stands still
    fn photographed(
        avatar: &Avatar,
    ) -> Vec<(
        OutlineMap,
        pirouette_body::Camera,
        pirouette_body::TurnAngle,
    )> {
        let camera = SyntheticOptions::camera_for(avatar.stature_mm(), 160, 200);
        SyntheticOptions::even_turns(8)
            .into_iter()
            .map(|turn| {
                let room_from_world = turn.room_from_world();
                let positions: Vec<DVec3> = avatar
                    .mesh
                    .positions
                    .iter()
                    .map(|&p| room_from_world * p)
                    .collect();
                let seen = render::silhouette(&positions, &avatar.mesh.triangles, &camera);
                (OutlineMap::new(&seen, OutlineMap::FAR_PX), camera, turn)
            })
            .collect()
    }

    fn avatar(mass_kg: f64) -> Avatar {
        mannequin(&MannequinParameters {
            stature_mm: Some(1700.0),
            mass_kg: Some(mass_kg),
            ..MannequinParameters::default()
        })
        .unwrap()
    }

    #[test]
    fn phantoms_are_removed_and_the_body_is_kept_for_any_build() {
        let options = CarveOptions {
            voxel_size_mm: 12.0,
            ..CarveOptions::default()
        };
        let average = avatar(64.0);
        for person in [&average, &avatar(110.0)] {
            let photographed = photographed(person);
            let views: Vec<CarveView> = photographed
                .iter()
                .map(|(outline, camera, turn)| CarveView {
                    outline,
                    camera: *camera,
                    turn: *turn,
                })
                .collect();
            let hull = carve(&views, &options).unwrap();
            let cut = carve_beside_avatar(&views, &average, &options).unwrap();
            assert_eq!(cut.check(), Ok(()));
            let body = person.mesh.volume();
            assert!(cut.volume() < hull.volume());
            assert!(cut.volume() > 0.99 * body, "{} {body}", cut.volume());
        }
    }
}
