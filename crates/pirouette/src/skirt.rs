//! Skirts: cloth between the legs, which no body has.
//!
//! Below the crotch, a posed body leaves a gap between its legs in each view. Where the silhouettes fill it down to one height
//! in all views, the person wears a skirt or a dress; trousers leave it open, and thighs that touch have none.

use glam::{DVec2, DVec3};
use pirouette_body::{Avatar, Bone, Joint};
use pirouette_geom::isosurface::{SurfaceOptions, extract_surface};
use pirouette_geom::nearest::NearestSurface;
use pirouette_geom::section::{convex_hull, plane_section};
use pirouette_geom::winding::WindingNumbers;
use pirouette_geom::{Mask, TriMesh};

use crate::color::SurfaceColors;
use crate::skeleton_fit::SkeletonView;

/// Height of a band of the legs that is judged as a whole, as a share of the stature
const BAND: f64 = 0.02;

/// Distance of the first band below the hip joints, as a share of the stature: below the crotch of most people
const BELOW_HIPS: f64 = 0.06;

/// Share of the gap in a band that a skirt fills
///
/// A skirt before a background of its color: 0.46 to 0.82 above the hem, 0.13 below. Trousers: up to 0.18.
const MIN_FILLED: f64 = 0.35;

/// Mean width of the gap over all views from which on a band is judged, as a share of the stature
const MIN_GAP: f64 = 0.006;

/// Shortest skirt, measured from the first band, as a share of the stature: wide shorts may cover less
const MIN_LENGTH: f64 = 0.06;

/// A skirt or the lower part of a dress
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skirt {
    /// Height of the hem above the floor, in mm
    pub hem_mm: f64,
}

/// The surface of a person with their skirt
#[derive(Debug, Clone)]
pub struct DressedBody {
    /// Body and skirt as one closed surface, with the bones of the body
    pub avatar: Avatar,
    /// Colors of the surface, if those of the body are known
    pub colors: Option<SurfaceColors>,
}

/// Distance of the sections that the skirt connects, and number of points on each
const SECTION_MM: f64 = 12.0;
const SECTION_POINTS: usize = 96;

/// Edge length of the cells in which the surfaces of body and skirt are united, in mm
const CELL_MM: f64 = 8.0;

/// The extent of both legs in one row of a photo
#[derive(Debug, Clone, Copy)]
struct Row {
    /// First and last column between the outer sides of the legs
    from: usize,
    to: usize,
    /// Height of the legs there, in mm
    height_mm: f64,
}

/// Returns the extent of both legs in each row that shows both
fn leg_rows(avatar: &Avatar, view: &SkeletonView, width: usize, height: usize) -> Vec<Option<Row>> {
    struct Extent {
        sides: [(f64, f64); 2],
        height_sum: f64,
        count: f64,
    }
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    let mut extents: Vec<Extent> = (0..height)
        .map(|_| Extent {
            sides: [none; 2],
            height_sum: 0.0,
            count: 0.0,
        })
        .collect();
    let positions = avatar.posed(&view.pose, view.turn).positions;
    let projector = view.camera.projector();
    // A vertex stands for its neighborhood.
    let px_per_mm = view.camera.focal_px() / view.camera.distance_mm;
    let reach = (0.008 * avatar.stature_mm() * px_per_mm).ceil() as isize;
    for (position, weight) in positions.iter().zip(&avatar.weights) {
        let side = match weight.strongest() {
            Bone::LeftThigh | Bone::LeftShin => 0,
            Bone::RightThigh | Bone::RightShin => 1,
            _ => continue,
        };
        let at = projector.project(*position);
        if !at.is_finite() {
            continue;
        }
        let row = at.y.floor() as isize;
        let rows = (row - reach).max(0)..(row + reach + 1).min(height as isize);
        for row in rows {
            let extent = &mut extents[row as usize];
            let side = &mut extent.sides[side];
            *side = (side.0.min(at.x), side.1.max(at.x));
            extent.height_sum += position.y;
            extent.count += 1.0;
        }
    }
    let row = |extent: Extent| {
        let [left, right] = extent.sides;
        let (from, to) = (left.0.min(right.0), left.1.max(right.1));
        let both = left.0 <= left.1 && right.0 <= right.1 && to > 0.0 && from < width as f64;
        both.then(|| Row {
            from: from.ceil().max(0.0) as usize,
            to: (to.floor().max(0.0) as usize).min(width.saturating_sub(1)),
            height_mm: extent.height_sum / extent.count,
        })
    };
    extents.into_iter().map(row).collect()
}

/// Finds a skirt by the silhouettes of all views
///
/// `bodies` are the silhouettes of the body in the poses of the `views`, in the size of the `silhouettes`.
pub(crate) fn find_skirt(
    avatar: &Avatar,
    views: &[SkeletonView],
    bodies: &[Mask],
    silhouettes: &[&Mask],
) -> Option<Skirt> {
    let stature_mm = avatar.stature_mm();
    let hips = [Joint::LeftHip, Joint::RightHip].map(|joint| avatar.keypoints[joint].y);
    let ankles = [Joint::LeftAnkle, Joint::RightAnkle].map(|joint| avatar.keypoints[joint].y);
    let top_mm = (hips[0] + hips[1]) / 2.0 - BELOW_HIPS * stature_mm;
    let bottom_mm = (ankles[0] + ankles[1]) / 2.0;
    let band_mm = BAND * stature_mm;
    let count = ((top_mm - bottom_mm) / band_mm).floor().max(0.0) as usize;
    // Of each band: the rows with a gap or without, the gap, and its filled part, in statures
    let mut gaps = vec![[0.0_f64; 2]; count];
    let mut rows_seen = vec![0.0_f64; count];
    for ((view, body), silhouette) in views.iter().zip(bodies).zip(silhouettes) {
        let stature_px = stature_mm * view.camera.focal_px() / view.camera.distance_mm;
        let rows = leg_rows(avatar, view, body.width(), body.height());
        for (y, row) in rows.into_iter().enumerate() {
            let Some(row) = row else { continue };
            let below_mm = top_mm - row.height_mm;
            if below_mm < 0.0 {
                continue;
            }
            let band = (below_mm / band_mm) as usize;
            let Some(gap) = gaps.get_mut(band) else {
                continue;
            };
            let columns = row.from..=row.to;
            let open = columns.filter(|&x| !body[(x, y)]);
            for x in open {
                gap[0] += 1.0 / stature_px;
                gap[1] += f64::from(u8::from(silhouette[(x, y)])) / stature_px;
            }
            rows_seen[band] += 1.0;
        }
    }
    let filled = |band: usize| {
        let [gap, filled] = gaps[band];
        let judged = gap >= MIN_GAP * rows_seen[band] && gap > 0.0;
        judged.then(|| filled / gap >= MIN_FILLED)
    };
    // The lowest band above the first that is open
    let closed = (0..count).take_while(|&band| filled(band) != Some(false));
    let last = closed.filter(|&band| filled(band) == Some(true)).last()?;
    let length_mm = (last + 1) as f64 * band_mm;
    (length_mm >= MIN_LENGTH * stature_mm).then_some(Skirt {
        hem_mm: top_mm - length_mm,
    })
}

impl Skirt {
    /// Adds the skirt to the silhouette of a body in a view: fills the rows between the legs, down to the hem
    pub(crate) fn fill(&self, avatar: &Avatar, view: &SkeletonView, body: &mut Mask) {
        let rows = leg_rows(avatar, view, body.width(), body.height());
        for (y, row) in rows.into_iter().enumerate() {
            if let Some(row) = row.filter(|row| row.height_mm >= self.hem_mm) {
                body.row_mut(y)[row.from..=row.to].fill(true);
            }
        }
    }
}

impl Skirt {
    /// Unites the surface of a body with the cloth between its legs: the convex hull of each section down to the hem
    ///
    /// Vertices get bones and colors of the nearest point of the body. `None` if the legs have no sections.
    pub(crate) fn dress(
        &self,
        body: &Avatar,
        colors: Option<&SurfaceColors>,
    ) -> Option<DressedBody> {
        let cloth = self.cloth(body)?;
        let mut both = body.mesh.clone();
        let offset = both.positions.len() as u32;
        both.positions.extend(&cloth.positions);
        let moved = cloth.triangles.iter().map(|t| t.map(|v| v + offset));
        both.triangles.extend(moved);
        let (winding, surface) = (WindingNumbers::new(&both), NearestSurface::new(&both));
        let (low, high) = both.bounds()?;
        let margin = DVec3::splat(2.5 * CELL_MM);
        let field = |point: DVec3| {
            let distance = surface
                .nearest(point)
                .map_or(f64::INFINITY, |found| found.distance);
            if winding.at(point) > 0.5 {
                -distance
            } else {
                distance
            }
        };
        let options = SurfaceOptions {
            lo: low - margin,
            hi: high + margin,
            cell_size: CELL_MM,
            lipschitz: 1.0,
            secant_steps: 2,
            thin_pieces: false,
        };
        let mut mesh = extract_surface(field, &options).ok()?.largest_component();
        let floor = mesh.bounds()?.0.y - low.y;
        mesh.positions.iter_mut().for_each(|p| p.y -= floor);
        let skin = NearestSurface::new(&body.mesh);
        let nearest = mesh.positions.iter().map(|&point| {
            let found = skin.nearest(point)?;
            let corners = body.mesh.triangles.get(found.triangle)?;
            let away = |v: &u32| body.mesh.positions[*v as usize].distance_squared(point);
            let nearer = |a: &&u32, b: &&u32| away(a).total_cmp(&away(b));
            corners.iter().min_by(nearer).map(|&v| v as usize)
        });
        let nearest: Vec<usize> = nearest.collect::<Option<_>>()?;
        let colors = colors.map(|colors| SurfaceColors {
            srgb: nearest.iter().map(|&v| colors.srgb[v]).collect(),
            view_counts: nearest.iter().map(|&v| colors.view_counts[v]).collect(),
        });
        let weights = nearest.iter().map(|&v| body.weights[v]).collect();
        Some(DressedBody {
            avatar: Avatar {
                mesh,
                weights,
                ..body.clone()
            },
            colors,
        })
    }

    /// Returns the closed surface around the convex hulls of the legs' sections, from the hips to the hem
    fn cloth(&self, body: &Avatar) -> Option<TriMesh> {
        let of_legs = |v: u32| {
            matches!(
                body.weights[v as usize].strongest(),
                Bone::Root | Bone::LeftThigh | Bone::RightThigh | Bone::LeftShin | Bone::RightShin
            )
        };
        let triangles = body.mesh.triangles.iter().copied();
        let legs = TriMesh {
            positions: body.mesh.positions.clone(),
            triangles: triangles
                .filter(|t| t.iter().all(|&v| of_legs(v)))
                .collect(),
        };
        let hips = [Joint::LeftHip, Joint::RightHip].map(|joint| body.keypoints[joint].y);
        let top_mm = (hips[0] + hips[1]) / 2.0;
        let count = ((top_mm - self.hem_mm) / SECTION_MM).floor().max(1.0) as usize;
        let mut positions = Vec::new();
        for level in 0..=count {
            let height_mm = top_mm + (self.hem_mm - top_mm) * level as f64 / count as f64;
            let loops = plane_section(&legs, DVec3::Y * height_mm, DVec3::Y);
            let flat = loops.iter().flatten().map(|p| DVec2::new(p.x, p.z));
            let hull = convex_hull(&flat.collect::<Vec<DVec2>>());
            let ring = ring(&hull)?;
            positions.extend(ring.map(|p| DVec3::new(p.x, height_mm, p.y)));
        }
        Some(tube(positions, count + 1))
    }
}

/// Returns [`SECTION_POINTS`] points of a convex polygon in even directions around its middle
fn ring(hull: &[DVec2]) -> Option<impl Iterator<Item = DVec2>> {
    if hull.len() < 3 {
        return None;
    }
    let middle = hull.iter().sum::<DVec2>() / hull.len() as f64;
    let points = (0..SECTION_POINTS).map(|i| {
        let angle = std::f64::consts::TAU * i as f64 / SECTION_POINTS as f64;
        let direction = DVec2::from_angle(angle);
        // The ray leaves the polygon through the side that it meets first.
        let sides = hull.iter().zip(hull.iter().cycle().skip(1));
        let reach = sides.filter_map(|(a, b)| {
            let side = *b - *a;
            let across = direction.perp_dot(side);
            let along = (*a - middle).perp_dot(side) / across;
            (across.abs() > 1e-12 && along > 0.0).then_some(along)
        });
        middle + direction * reach.fold(f64::INFINITY, f64::min)
    });
    let points: Vec<DVec2> = points.collect();
    let finite = points.iter().all(|p| p.is_finite());
    finite.then(|| points.into_iter())
}

/// Connects rings of [`SECTION_POINTS`] points, top to bottom, to a closed surface that faces outward
fn tube(mut positions: Vec<DVec3>, rings: usize) -> TriMesh {
    let count = SECTION_POINTS as u32;
    let last = (rings as u32 - 1) * count;
    let middle = |ring: &[DVec3]| ring.iter().sum::<DVec3>() / f64::from(count);
    let top = middle(&positions[..SECTION_POINTS]);
    let bottom = middle(&positions[last as usize..]);
    positions.extend([top, bottom]);
    let (top, bottom) = (last + count, last + count + 1);
    let mut triangles = Vec::new();
    for i in 0..count {
        let j = (i + 1) % count;
        for ring in 0..rings as u32 - 1 {
            let (above, below) = (ring * count, (ring + 1) * count);
            triangles.push([above + i, above + j, below + i]);
            triangles.push([above + j, below + j, below + i]);
        }
        triangles.push([top, j, i]);
        triangles.push([bottom, last + i, last + j]);
    }
    TriMesh {
        positions,
        triangles,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skeleton_fit::TurnFrom;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};
    use pirouette_body::render::SilhouetteMesh;
    use pirouette_body::{Keypoint, Keypoints, PerJoint, Pose, Sex};
    use pirouette_synthetic::SyntheticOptions;

    fn person(mass_kg: f64) -> Avatar {
        mannequin(&MannequinParameters {
            sex: Sex::Female,
            stature_mm: Some(1650.0),
            mass_kg: Some(mass_kg),
            ..MannequinParameters::default()
        })
        .expect("a mannequin of this mass")
    }

    /// Returns eight views of a person who stands still, and the silhouettes in them
    fn photographed(avatar: &Avatar) -> (Vec<SkeletonView>, Vec<Mask>) {
        let camera = SyntheticOptions::camera_for(avatar.stature_mm(), 240, 300);
        let turns = SyntheticOptions::even_turns(8).into_iter();
        let views: Vec<SkeletonView> = turns
            .map(|turn| SkeletonView {
                turn,
                turn_sd_radians: 0.0,
                turn_from: TurnFrom::Stated,
                tracked: None,
                camera,
                keypoints: Keypoints::new(PerJoint::splat(Keypoint::default())),
                pose: Pose::default(),
            })
            .collect();
        let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
        let silhouette = |view: &SkeletonView| {
            let positions = avatar.posed(&view.pose, view.turn).positions;
            mesh.silhouette(&positions, &view.camera).threshold(0.5)
        };
        let silhouettes = views.iter().map(silhouette).collect();
        (views, silhouettes)
    }

    #[test]
    fn legs_wear_no_skirt_whether_thighs_touch_or_not() {
        for mass_kg in [50.0, 64.0, 95.0] {
            let avatar = person(mass_kg);
            let (views, bodies) = photographed(&avatar);
            let silhouettes: Vec<&Mask> = bodies.iter().collect();
            assert_eq!(find_skirt(&avatar, &views, &bodies, &silhouettes), None);
        }
    }

    #[test]
    fn the_hem_is_found_where_silhouettes_no_longer_fill_the_gap() {
        let avatar = person(64.0);
        let (views, bodies) = photographed(&avatar);
        for hem_mm in [250.0, 400.0, 600.0] {
            let mut dressed = bodies.clone();
            for (mask, view) in dressed.iter_mut().zip(&views) {
                Skirt { hem_mm }.fill(&avatar, view, mask);
            }
            let silhouettes: Vec<&Mask> = dressed.iter().collect();
            let found = find_skirt(&avatar, &views, &bodies, &silhouettes);
            let error_mm = found.expect("a skirt").hem_mm - hem_mm;
            assert!(
                error_mm.abs() < 2.0 * BAND * avatar.stature_mm(),
                "{error_mm}"
            );
        }
    }

    #[test]
    fn a_skirt_in_one_view_only_is_none() {
        let avatar = person(64.0);
        let (views, bodies) = photographed(&avatar);
        let mut dressed = bodies.clone();
        Skirt { hem_mm: 400.0 }.fill(&avatar, &views[0], &mut dressed[0]);
        let silhouettes: Vec<&Mask> = dressed.iter().collect();
        assert_eq!(find_skirt(&avatar, &views, &bodies, &silhouettes), None);
    }

    #[test]
    fn body_and_skirt_are_one_closed_surface_that_bridges_the_legs() {
        let avatar = person(64.0);
        let (hem_mm, knee_mm) = (400.0, 500.0);
        let found = Skirt { hem_mm }.dress(&avatar, None);
        let mesh = found.expect("legs have sections").avatar.mesh;
        assert_eq!(mesh.check(), Ok(()));
        assert!(mesh.volume() > avatar.mesh.volume());
        let low = mesh.bounds().expect("not empty").0.y;
        assert!(low.abs() < 1e-6, "{low}");
        let winding = WindingNumbers::new(&mesh);
        let legs = [Joint::LeftKnee, Joint::RightKnee].map(|joint| avatar.keypoints[joint]);
        let between = (legs[0] + legs[1]) / 2.0;
        let inside = |height_mm: f64| winding.at(DVec3::new(between.x, height_mm, between.z)) > 0.5;
        assert!(inside(knee_mm) && inside(hem_mm + 20.0));
        assert!(!inside(hem_mm - 20.0));
        // The surface of the rest is that of the body.
        let body = NearestSurface::new(&avatar.mesh);
        let above = mesh.positions.iter().filter(|p| p.y > 1000.0);
        for &point in above {
            let distance = body.nearest(point).expect("not empty").distance;
            assert!(distance < 2.0, "{point} {distance}");
        }
    }
}
