//! Carving: from silhouettes to the visual hull.
//!
//! The hull contains every point that all silhouettes show as person. Hollows that no silhouette shows stay
//! filled: the navel, the hollow of an armpit. From few directions it is larger than the body: a circle
//! seen from eight evenly spread turns becomes an octagon, 5.5 % longer around.
//!
//! The surface is extracted where the largest signed distance to the silhouettes' outlines, in mm at the
//! depth of the point, is zero; outlines count with their fractions of a pixel.

mod outline_map;
mod phantom;

use std::f64::consts::PI;

use glam::DVec3;
use pirouette_geom::isosurface::{SurfaceError, SurfaceOptions, extract_surface};
use pirouette_geom::{Grid, TriMesh};
use rayon::prelude::*;

use crate::avatar::Avatar;
use crate::camera::Camera;
use crate::units::TurnAngle;
pub(crate) use outline_map::OutlineMap;
use phantom::PhantomField;

/// One silhouette and how it was seen
#[derive(Debug, Clone, Copy)]
pub struct CarveView<'a> {
    /// Coverage of each pixel by the person, 0 to 1; the outline is where it is one half
    pub silhouette: &'a Grid<f32>,
    /// The camera; its size in pixels is that of the silhouette
    pub camera: Camera,
    /// How far the person has turned
    pub turn: TurnAngle,
}

/// How finely and how strictly to carve
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarveOptions {
    /// Edge length of the finest cells, in mm; halving it costs four times the time and the triangles
    ///
    /// Parts thinner than a cell can be lost.
    pub voxel_size_mm: f64,
    /// Views that must miss a point before it is removed; above 1 forgives a bad mask, fattens the hull
    pub misses_to_remove: usize,
}

impl Default for CarveOptions {
    fn default() -> Self {
        Self {
            voxel_size_mm: 4.0,
            misses_to_remove: 1,
        }
    }
}

/// Why there is no hull
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CarveError {
    /// Too few silhouettes show anything
    #[error("{usable} of {given} silhouettes show a person; carving needs at least 2")]
    TooFewViews {
        /// Silhouettes that are not empty
        usable: usize,
        /// Silhouettes given
        given: usize,
    },
    /// All views look along nearly the same line
    #[error(
        "the views differ by at most {spread_degrees:.0} degrees from one line of sight; carving needs \
         directions at least {needed_degrees:.0} degrees apart"
    )]
    OneDirection {
        /// Largest angle between two lines of sight, opposite ones being the same
        spread_degrees: f64,
        /// Smallest angle that gives a bounded hull
        needed_degrees: f64,
    },
    /// A turn angle is NaN or infinite
    #[error("the turn angle of silhouette {view} is not finite")]
    TurnAngle {
        /// Index of the view
        view: usize,
    },
    /// A camera cannot see
    #[error(
        "the camera of silhouette {view} needs a field of view between 0 and 180 degrees, a positive distance \
         and finite height and pitch: {camera:?}"
    )]
    Camera {
        /// Index of the view
        view: usize,
        /// The camera
        camera: Camera,
    },
    /// Silhouette and camera differ in size
    #[error(
        "silhouette {view} has {width} x {height} px, its camera {camera_width} x {camera_height} px"
    )]
    Size {
        /// Index of the view
        view: usize,
        /// Columns of the silhouette
        width: usize,
        /// Rows of the silhouette
        height: usize,
        /// Columns of the camera
        camera_width: usize,
        /// Rows of the camera
        camera_height: usize,
    },
    /// No number of misses removes anything
    #[error("misses_to_remove must be between 1 and the {usable} usable views, not {misses}")]
    Misses {
        /// The option
        misses: usize,
        /// Silhouettes that are not empty
        usable: usize,
    },
    /// The grid cannot be laid out
    #[error("the voxel size of {voxel_size_mm} mm does not fit")]
    VoxelSize {
        /// The option
        voxel_size_mm: f64,
        /// What the grid says
        source: SurfaceError,
    },
    /// The silhouettes have no point in common
    #[error("the silhouettes have no point in common: check the turn angles and the camera")]
    Empty,
}

/// Lines of sight must differ by this angle
///
/// Below, the hull stretches along the line of sight to five times the body's depth and more.
const MIN_SPREAD_DEGREES: f64 = 20.0;

/// Part of the camera's distance within which the hull is looked for
///
/// Nobody turns on the spot nearer to the camera than a quarter of the way; beyond, the box would hold
/// the camera itself, where every silhouette is a point.
const MAX_RADIUS_PART: f64 = 0.75;

/// Height up to which the hull is looked for, in mm; the tallest person ever measured had 2720
const MAX_HEIGHT_MM: f64 = 3000.0;

/// Field evaluations that refine each vertex: one mends what linear interpolation misses at the hull's edges
const SECANT_STEPS: usize = 1;

/// Carves the visual hull: its largest piece, closed, manifold and outward oriented, cut off at the floor
///
/// World frame, mm. Beyond the border of a photo nothing counts as person, except where the silhouette
/// itself is cut off by the border: there, that view removes nothing. Points that no photo shows are not
/// part of the hull. Empty silhouettes are left out.
///
/// # Errors
/// When fewer than two silhouettes show anything, all from one direction, when an angle, a camera or an option
/// makes no sense, or when nothing is left.
pub fn carve(views: &[CarveView], options: &CarveOptions) -> Result<TriMesh, CarveError> {
    let hull = HullField::new(views, options.misses_to_remove)?;
    extract(&hull, |point| hull.value(point), options)
}

/// Carves the visual hull and cuts off what the avatar's own hull from the same views shows to be phantoms
///
/// The avatar stands in the world frame in the pose of the silhouettes. Only points that lie clearly off the
/// avatar, yet within what the views could make of it, are cut: a belly that no silhouette of the avatar
/// covers stays.
///
/// # Errors
/// As [`carve`].
pub fn carve_beside_avatar(
    views: &[CarveView],
    avatar: &Avatar,
    options: &CarveOptions,
) -> Result<TriMesh, CarveError> {
    let hull = HullField::new(views, options.misses_to_remove)?;
    let phantoms = PhantomField::new(views, avatar)?;
    let field = |point| {
        let outside = hull.value(point);
        // Outside the hull nothing is left to cut.
        if outside > 0.0 || outside.is_nan() {
            return outside;
        }
        outside.max(phantoms.value(point))
    };
    extract(&hull, field, options)
}

/// The largest piece of the surface of a field whose slope and size are the hull's
fn extract(
    hull: &HullField,
    field: impl Fn(DVec3) -> f64 + Sync,
    options: &CarveOptions,
) -> Result<TriMesh, CarveError> {
    let voxel = options.voxel_size_mm;
    let radius = hull.radius_mm;
    let surface = SurfaceOptions {
        // The floor runs through the middle of the cells, where interpolation is exact.
        lo: DVec3::new(-radius, -1.5 * voxel, -radius),
        hi: DVec3::new(radius, MAX_HEIGHT_MM, radius),
        cell_size: voxel,
        lipschitz: hull.lipschitz,
        secant_steps: SECANT_STEPS,
    };
    let mesh = extract_surface(field, &surface).map_err(|source| CarveError::VoxelSize {
        voxel_size_mm: voxel,
        source,
    })?;
    if mesh.triangles.is_empty() {
        return Err(CarveError::Empty);
    }
    Ok(mesh.largest_component())
}

/// Signed distance to the hull: never more than the true distance by much, zero on its surface
struct HullField {
    views: Vec<ProjectedView>,
    misses_to_remove: usize,
    /// Whether a silhouette is cut off by the border of its photo
    any_cut: bool,
    /// Half the edge of the box to search, in mm
    radius_mm: f64,
    /// Bound of the field's slope
    lipschitz: f64,
}

/// A silhouette's outline map and the projection onto it
struct ProjectedView {
    map: OutlineMap,
    /// View frame (x right, y down, z forward, mm) of the world origin
    origin: DVec3,
    /// View frame of the world's axes
    axes: [DVec3; 3],
    focal_px: f64,
    /// Principal point, px
    center: [f64; 2],
}

impl HullField {
    fn new(views: &[CarveView], misses_to_remove: usize) -> Result<Self, CarveError> {
        for (index, view) in views.iter().enumerate() {
            check_view(index, view)?;
        }
        let used: Vec<(&CarveView, OutlineMap)> = views
            .par_iter()
            .filter_map(|view| Some((view, OutlineMap::new(view.silhouette)?)))
            .collect();
        let usable = used.len();
        if usable < 2 {
            return Err(CarveError::TooFewViews {
                usable,
                given: views.len(),
            });
        }
        let spread_degrees = direction_spread(used.iter().map(|(v, _)| v.turn)).to_degrees();
        if spread_degrees < MIN_SPREAD_DEGREES {
            return Err(CarveError::OneDirection {
                spread_degrees,
                needed_degrees: MIN_SPREAD_DEGREES,
            });
        }
        if !(1..=usable).contains(&misses_to_remove) {
            return Err(CarveError::Misses {
                misses: misses_to_remove,
                usable,
            });
        }
        let (mut nearest, mut lipschitz) = (f64::INFINITY, 1.0f64);
        for (view, _) in &used {
            nearest = nearest.min(view.camera.distance_mm);
            lipschitz = lipschitz.max(slope_bound(&view.camera));
        }
        Ok(Self {
            any_cut: used.iter().any(|(_, map)| map.cut),
            radius_mm: MAX_RADIUS_PART * nearest,
            lipschitz,
            views: used
                .into_iter()
                .map(|(view, map)| ProjectedView::new(view, map))
                .collect(),
            misses_to_remove,
        })
    }

    /// Signed distance at a world point, in mm; negative inside the hull, NaN where a camera cannot tell
    fn value(&self, point: DVec3) -> f64 {
        let mut unseen = f64::INFINITY;
        let mut distance = |view: &ProjectedView| {
            let (to_outline, to_photo) = view.distances(point);
            unseen = unseen.min(to_photo);
            to_outline
        };
        let hull = if self.misses_to_remove == 1 {
            self.views
                .iter()
                .map(&mut distance)
                .fold(f64::NEG_INFINITY, nan_max)
        } else {
            let mut all: Vec<f64> = self.views.iter().map(&mut distance).collect();
            all.sort_unstable_by(|a, b| b.total_cmp(a));
            all[self.misses_to_remove - 1]
        };
        let hull = if self.any_cut { hull.max(unseen) } else { hull };
        nan_max(hull, -point.y)
    }
}

/// The larger number; NaN if one is, unlike `f64::max`
fn nan_max(a: f64, b: f64) -> f64 {
    if a >= b || a.is_nan() { a } else { b }
}

fn check_view(view: usize, given: &CarveView) -> Result<(), CarveError> {
    let CarveView {
        silhouette,
        camera,
        turn,
    } = given;
    if !turn.radians().is_finite() {
        return Err(CarveError::TurnAngle { view });
    }
    let sees = camera.vertical_fov_radians > 0.0
        && camera.vertical_fov_radians < PI
        && camera.distance_mm > 0.0
        && camera.distance_mm.is_finite()
        && camera.height_mm.is_finite()
        && camera.pitch_radians.is_finite();
    if !sees {
        return Err(CarveError::Camera {
            view,
            camera: *camera,
        });
    }
    if (silhouette.width(), silhouette.height()) != (camera.width_px, camera.height_px) {
        return Err(CarveError::Size {
            view,
            width: silhouette.width(),
            height: silhouette.height(),
            camera_width: camera.width_px,
            camera_height: camera.height_px,
        });
    }
    Ok(())
}

/// Largest angle between two lines of sight, where opposite directions are one line
fn direction_spread(turns: impl Iterator<Item = TurnAngle>) -> f64 {
    let lines: Vec<f64> = turns.map(|turn| turn.radians().rem_euclid(PI)).collect();
    let mut spread: f64 = 0.0;
    for (i, a) in lines.iter().enumerate() {
        for b in &lines[..i] {
            let difference = (a - b).abs();
            spread = spread.max(difference.min(PI - difference));
        }
    }
    spread
}

/// Bound of how fast a silhouette's distance in mm changes per mm
///
/// Across the line of sight by 1 / cos of the angle off the optical axis; along it, the distance grows with the
/// depth, which adds 15 % within a quarter of the depth; larger blocks are never skipped.
fn slope_bound(camera: &Camera) -> f64 {
    let half_diagonal = (camera.width_px as f64).hypot(camera.height_px as f64) / 2.0;
    1.15 * (half_diagonal / camera.focal_px()).hypot(1.0)
}

impl ProjectedView {
    fn new(view: &CarveView, map: OutlineMap) -> Self {
        let room_from_world = view.turn.room_from_world();
        let origin = view.camera.view_from_room(DVec3::ZERO);
        Self {
            map,
            origin,
            axes: DVec3::AXES
                .map(|axis| view.camera.view_from_room(room_from_world * axis) - origin),
            focal_px: view.camera.focal_px(),
            center: [
                view.camera.width_px as f64 / 2.0,
                view.camera.height_px as f64 / 2.0,
            ],
        }
    }

    /// Signed distances in mm at the depth of a world point: to the silhouette's outline and to the photo's border
    ///
    /// NaN at and behind the camera.
    #[inline]
    fn distances(&self, point: DVec3) -> (f64, f64) {
        let [x, y, z] = self.axes;
        let in_view = self.origin + x * point.x + y * point.y + z * point.z;
        if in_view.z <= 0.0 {
            return (f64::NAN, f64::NAN);
        }
        let mm_per_px = in_view.z / self.focal_px;
        let u = self.center[0] + in_view.x / mm_per_px;
        let v = self.center[1] + in_view.y / mm_per_px;
        let to_photo = f64::max(
            (u - self.center[0]).abs() - self.center[0],
            (v - self.center[1]).abs() - self.center[1],
        );
        (self.map.at(u, v) * mm_per_px, to_photo * mm_per_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use pirouette_geom::coverage::fill_polygons;
    use proptest::prelude::*;

    /// An ellipsoid with its axes along the world's
    #[derive(Debug, Clone, Copy)]
    struct Ellipsoid {
        center: DVec3,
        radii: DVec3,
    }

    impl Ellipsoid {
        fn volume(&self) -> f64 {
            4.0 / 3.0 * PI * self.radii.element_product()
        }

        /// Outline in the photo: projection of the circle where lines of sight touch the surface
        fn outline(&self, camera: &Camera, turn: TurnAngle) -> Vec<DVec2> {
            let room_from_world = turn.room_from_world();
            let eye = room_from_world.transpose() * camera.center() - self.center;
            // In the frame where the ellipsoid is the unit sphere
            let eye = eye / self.radii;
            let (a, b) = (eye / eye.length()).any_orthonormal_pair();
            let distance_squared = eye.length_squared();
            let radius = (1.0 - 1.0 / distance_squared).sqrt();
            (0..720)
                .map(|i| {
                    let (sin, cos) = (f64::from(i) / 720.0 * std::f64::consts::TAU).sin_cos();
                    let touch = eye / distance_squared + (a * cos + b * sin) * radius;
                    camera.project(room_from_world * (self.center + touch * self.radii))
                })
                .collect()
        }

        fn surface_points(&self) -> impl Iterator<Item = DVec3> + '_ {
            (0..300).map(|i| {
                let height = (f64::from(i) + 0.5) / 150.0 - 1.0;
                let (sin, cos) = (f64::from(i) * 2.399_963).sin_cos();
                let ring = (1.0 - height * height).sqrt();
                self.center + self.radii * DVec3::new(ring * cos, height, ring * sin)
            })
        }
    }

    /// A trunk, a head that floats a little above it, and an arm
    fn body() -> [Ellipsoid; 3] {
        let part = |center: [f64; 3], radii: [f64; 3]| Ellipsoid {
            center: DVec3::from_array(center),
            radii: DVec3::from_array(radii),
        };
        [
            part([0.0, 700.0, 10.0], [180.0, 650.0, 130.0]),
            part([0.0, 1400.0, 30.0], [80.0, 120.0, 100.0]),
            part([230.0, 900.0, 0.0], [120.0, 40.0, 45.0]),
        ]
    }

    fn camera() -> Camera {
        Camera {
            width_px: 300,
            height_px: 400,
            vertical_fov_radians: 0.75,
            height_mm: 900.0,
            distance_mm: 2400.0,
            pitch_radians: 0.06,
        }
    }

    fn turns(count: usize) -> Vec<TurnAngle> {
        let turn = |i| TurnAngle::from_degrees(360.0 * i as f64 / count as f64);
        (0..count).map(turn).collect()
    }

    /// Silhouettes of ellipsoids, and the outlines they are filled from
    fn render(parts: &[Ellipsoid], camera: &Camera, turns: &[TurnAngle]) -> Vec<Grid<f32>> {
        turns
            .iter()
            .map(|&turn| {
                let outlines: Vec<Vec<DVec2>> = parts
                    .iter()
                    .map(|part| part.outline(camera, turn))
                    .collect();
                fill_polygons(camera.width_px, camera.height_px, &outlines)
            })
            .collect()
    }

    fn views<'a>(
        silhouettes: &'a [Grid<f32>],
        camera: Camera,
        turns: &[TurnAngle],
    ) -> Vec<CarveView<'a>> {
        silhouettes
            .iter()
            .zip(turns)
            .map(|(silhouette, &turn)| CarveView {
                silhouette,
                camera,
                turn,
            })
            .collect()
    }

    fn coarse() -> CarveOptions {
        CarveOptions {
            voxel_size_mm: 12.0,
            ..CarveOptions::default()
        }
    }

    #[test]
    fn four_views_of_a_sphere_give_a_closed_manifold_hull() {
        let ball = Ellipsoid {
            center: DVec3::new(20.0, 900.0, -30.0),
            radii: DVec3::splat(200.0),
        };
        let turns = turns(4);
        let silhouettes = render(&[ball], &camera(), &turns);
        let hull = carve(&views(&silhouettes, camera(), &turns), &coarse()).expect("a hull");
        assert_eq!(hull.check(), Ok(()));
        // Two crossed cylinders hold 16/3 r^3: 1.27 times the ball.
        let ratio = hull.volume() / ball.volume();
        assert!((1.15..1.30).contains(&ratio), "{ratio}");
    }

    #[test]
    fn the_hull_lies_on_the_outlines_to_a_fraction_of_a_pixel() {
        let ball = Ellipsoid {
            center: DVec3::new(20.0, 900.0, -30.0),
            radii: DVec3::new(220.0, 300.0, 150.0),
        };
        let turns = turns(5);
        let silhouettes = render(&[ball], &camera(), &turns);
        let views = views(&silhouettes, camera(), &turns);
        let hull = carve(&views, &coarse()).expect("a hull");
        let outlines: Vec<Vec<DVec2>> = turns.iter().map(|&t| ball.outline(&camera(), t)).collect();
        let mut sum_squares = 0.0;
        for &p in &hull.positions {
            // The outline that the vertex lies on; a vertex at an edge of the hull lies on two.
            let mut nearest = f64::INFINITY;
            for (view, outline) in views.iter().zip(&outlines) {
                let q = camera().project(view.turn.room_from_world() * p);
                let distance = outline.iter().map(|o| (*o - q).length());
                nearest = nearest.min(distance.fold(f64::INFINITY, f64::min));
            }
            assert!(nearest < 0.6, "{nearest} px at {p}");
            sum_squares += nearest * nearest;
        }
        // Neighboring outline points are up to 0.7 px apart, which alone gives 0.2.
        let rms = (sum_squares / hull.positions.len() as f64).sqrt();
        assert!(rms < 0.25, "{rms} px");
    }

    #[test]
    fn the_hull_contains_the_body() {
        let turns = turns(7);
        let silhouettes = render(&body(), &camera(), &turns);
        let field = HullField::new(&views(&silhouettes, camera(), &turns), 1).expect("a field");
        for part in body() {
            for p in part.surface_points().filter(|p| p.y > 0.0) {
                // A fifth of a pixel
                assert!(field.value(p) < 1.0, "{} mm outside at {p}", field.value(p));
            }
        }
    }

    #[test]
    fn one_more_view_never_grows_the_hull() {
        let turns = turns(7);
        let silhouettes = render(&body(), &camera(), &turns);
        let views = views(&silhouettes, camera(), &turns);
        let mut last: Option<(HullField, f64)> = None;
        for count in 2..=7 {
            let mesh = carve(&views[..count], &coarse()).expect("a hull");
            assert_eq!(mesh.check(), Ok(()));
            if let Some((before, volume)) = &last {
                assert!(mesh.volume() <= volume * (1.0 + 1e-9));
                for &p in &mesh.positions {
                    assert!(before.value(p) < 1.0);
                }
            }
            let field = HullField::new(&views[..count], 1).expect("a field");
            last = Some((field, mesh.volume()));
        }
    }

    #[test]
    fn forgiving_one_miss_keeps_what_a_bad_mask_would_remove() {
        let turns = turns(7);
        let mut silhouettes = render(&body(), &camera(), &turns);
        let strict = carve(&views(&silhouettes, camera(), &turns), &coarse()).expect("a hull");
        for y in 150..250 {
            silhouettes[3].row_mut(y).fill(0.0);
        }
        let bad = views(&silhouettes, camera(), &turns);
        let cut = carve(&bad, &coarse()).expect("a hull");
        let forgiving = CarveOptions {
            misses_to_remove: 2,
            ..coarse()
        };
        let mended = carve(&bad, &forgiving).expect("a hull");
        assert!(cut.volume() < 0.7 * strict.volume());
        assert!(mended.volume() > strict.volume());
        assert_eq!(mended.check(), Ok(()));
    }

    #[test]
    fn the_hull_stands_on_the_floor() {
        let turns = turns(6);
        let silhouettes = render(&body(), &camera(), &turns);
        let hull = carve(&views(&silhouettes, camera(), &turns), &coarse()).expect("a hull");
        let (lo, _) = hull.bounds().expect("there are vertices");
        // The trunk reaches below the floor; its hull is cut off there.
        let sunk = Ellipsoid {
            center: DVec3::new(0.0, 400.0, 0.0),
            radii: DVec3::new(150.0, 600.0, 150.0),
        };
        let silhouettes = render(&[sunk], &camera(), &turns);
        let cut = carve(&views(&silhouettes, camera(), &turns), &coarse()).expect("a hull");
        let (cut_lo, _) = cut.bounds().expect("there are vertices");
        assert!(lo.y > 20.0);
        assert!(cut_lo.y.abs() < 1e-9, "{}", cut_lo.y);
        assert_eq!(cut.check(), Ok(()));
    }

    #[test]
    fn a_border_that_cuts_the_silhouette_does_not_carve() {
        let turns = turns(6);
        let whole = render(&body(), &camera(), &turns);
        let expected = carve(&views(&whole, camera(), &turns), &coarse()).expect("a hull");
        // The same camera with a narrower sensor in one view: the arm leaves the photo.
        let narrow = Camera {
            width_px: 110,
            ..camera()
        };
        let cropped = whole[0].crop(95, 0, 110, 400);
        let mut all = views(&whole, camera(), &turns);
        all[0] = CarveView {
            silhouette: &cropped,
            camera: narrow,
            turn: turns[0],
        };
        let hull = carve(&all, &coarse()).expect("a hull");
        assert_eq!(hull.check(), Ok(()));
        let arm_reach = |mesh: &TriMesh| mesh.bounds().expect("there are vertices").1.x;
        assert!(arm_reach(&expected) > 330.0);
        assert!(arm_reach(&hull) > 0.98 * arm_reach(&expected));
    }

    #[test]
    fn what_no_photo_shows_is_not_part_of_the_hull() {
        let turns = turns(6);
        let silhouettes = render(&body(), &camera(), &turns);
        let low = Camera {
            height_px: 250,
            vertical_fov_radians: 2.0 * (125.0 / camera().focal_px()).atan(),
            ..camera()
        };
        let cropped: Vec<Grid<f32>> = silhouettes
            .iter()
            .map(|s| s.crop(0, 75, 300, 250))
            .collect();
        let hull = carve(&views(&cropped, low, &turns), &coarse()).expect("a hull");
        let (_, hi) = hull.bounds().expect("there are vertices");
        assert!((1100.0..1600.0).contains(&hi.y), "{}", hi.y);
        assert_eq!(hull.check(), Ok(()));
    }

    #[test]
    fn senseless_input_is_named() {
        let turns = turns(4);
        let silhouettes = render(&body(), &camera(), &turns);
        let sound = views(&silhouettes, camera(), &turns);
        let error = |views: &[CarveView], options: &CarveOptions| {
            carve(views, options).expect_err("the input makes no sense")
        };

        assert!(matches!(
            error(&[], &coarse()),
            CarveError::TooFewViews { .. }
        ));
        let blank = Grid::filled(300, 400, f32::NAN);
        let mut views = sound[..2].to_vec();
        views[1].silhouette = &blank;
        let few = error(&views, &coarse());
        assert_eq!(
            few.to_string(),
            "1 of 2 silhouettes show a person; carving needs at least 2"
        );

        let mut views = sound.clone();
        views[2].turn = TurnAngle::from_degrees(f64::NAN);
        assert_eq!(error(&views, &coarse()), CarveError::TurnAngle { view: 2 });

        let mut views = sound.clone();
        views[3].camera.distance_mm = -1.0;
        assert!(matches!(
            error(&views, &coarse()),
            CarveError::Camera { view: 3, .. }
        ));

        let mut views = sound.clone();
        views[0].camera.width_px = 301;
        assert!(matches!(
            error(&views, &coarse()),
            CarveError::Size { view: 0, .. }
        ));

        let opposite = [sound[0], sound[2]];
        assert!(matches!(
            error(&opposite, &coarse()),
            CarveError::OneDirection { .. }
        ));

        for misses_to_remove in [0, 5] {
            let options = CarveOptions {
                misses_to_remove,
                ..coarse()
            };
            assert!(matches!(error(&sound, &options), CarveError::Misses { .. }));
        }
        for voxel_size_mm in [0.0, f64::NAN, 1e-9] {
            let options = CarveOptions {
                voxel_size_mm,
                ..coarse()
            };
            assert!(matches!(
                error(&sound, &options),
                CarveError::VoxelSize { .. }
            ));
        }

        // The same silhouette from all sides, but far off the axis: no common point
        let aside = Ellipsoid {
            center: DVec3::new(350.0, 900.0, 0.0),
            radii: DVec3::splat(60.0),
        };
        let one = render(&[aside], &camera(), &turns[..1]);
        let mut views = sound;
        for view in &mut views {
            view.silhouette = &one[0];
        }
        assert_eq!(error(&views, &coarse()), CarveError::Empty);
    }

    #[test]
    fn tiny_photos_do_no_harm() {
        let full = Grid::filled(1, 1, 1.0);
        let tiny = Camera {
            width_px: 1,
            height_px: 1,
            ..camera()
        };
        let turns = turns(3);
        let views: Vec<CarveView> = turns
            .iter()
            .map(|&turn| CarveView {
                silhouette: &full,
                camera: tiny,
                turn,
            })
            .collect();
        let options = CarveOptions {
            voxel_size_mm: 50.0,
            ..coarse()
        };
        if let Ok(mesh) = carve(&views, &options) {
            assert_eq!(mesh.check(), Ok(()));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]

        #[test]
        fn turning_all_angles_turns_the_hull(by in -3.0..3.0f64, x in -200.0..200.0f64, z in -200.0..200.0f64) {
            let turns: Vec<TurnAngle> = turns(5);
            let silhouettes = render(&body(), &camera(), &turns);
            let turned: Vec<TurnAngle> = turns
                .iter()
                .map(|t| TurnAngle::from_radians(t.radians() + by))
                .collect();
            let field = HullField::new(&views(&silhouettes, camera(), &turns), 1).expect("a field");
            let other = HullField::new(&views(&silhouettes, camera(), &turned), 1).expect("a field");
            let p = DVec3::new(x, 800.0, z);
            let carried = TurnAngle::from_radians(-by).room_from_world() * p;
            prop_assert!((field.value(p) - other.value(carried)).abs() < 1e-6);
        }
    }
}
