//! Carving: computes the visual hull from silhouettes.
//!
//! The hull contains every point that all silhouettes show as person. Hollows that appear in no silhouette remain
//! filled: the navel, the hollow of an armpit. From few directions it is larger than the body: a circle seen from eight
//! evenly spread turns becomes an octagon with a 5.5 % longer perimeter.
//!
//! The surface is extracted at the zero level of the largest signed distance to the silhouettes' outlines, in mm at the
//! depth of the point; outlines are accurate to fractions of a pixel.
//!
//! # Source
//! Laurentini, "The Visual Hull Concept for Silhouette-Based Image Understanding", PAMI 16(2), 1994, for the hull and
//! its limits.

mod phantom;
mod projected_view;

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use pirouette_geom::TriMesh;
use pirouette_geom::isosurface::{Field, SurfaceError, SurfaceOptions, extract_surface};

use phantom::PhantomField;
use pirouette_body::{Avatar, Camera, TurnAngle};
use pirouette_geom::outline_map::OutlineMap;
use projected_view::{ProjectedView, ViewSet, nan_max};

/// One silhouette with its camera and turn angle
#[derive(Debug, Clone, Copy)]
pub struct CarveView<'a> {
    /// Signed distances to the outline of its soft coverage, of reach [`OutlineMap::FAR_PX`]
    pub outline: &'a OutlineMap,
    /// The camera; its size in pixels is that of the silhouette
    pub camera: Camera,
    /// Turn angle of the person
    pub turn: TurnAngle,
}

/// Resolution and strictness of carving
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarveOptions {
    /// Edge length of the finest cells, in mm; halving it costs four times the time and the triangles
    ///
    /// Parts thinner than a cell can be lost.
    pub voxel_size_mm: f64,
    /// Number of views that must miss a point before it is removed; above 1 tolerates a bad mask, but enlarges the hull
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

/// Why carving failed
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CarveError {
    /// Too few nonempty silhouettes
    #[error("{usable} of {given} silhouettes show a person; carving needs at least 2")]
    TooFewViews {
        /// Number of nonempty silhouettes
        usable: usize,
        /// Number of silhouettes given
        given: usize,
    },
    /// All views have nearly the same line of sight
    #[error(
        "the views differ by at most {spread_degrees:.0} degrees from one line of sight; carving needs \
         directions at least {needed_degrees:.0} degrees apart"
    )]
    OneDirection {
        /// Largest angle between two lines of sight, treating opposite ones as equal
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
    /// A camera has invalid parameters
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
    /// The number of misses can never be reached
    #[error("misses_to_remove must be between 1 and the {usable} usable views, not {misses}")]
    Misses {
        /// The option
        misses: usize,
        /// Number of nonempty silhouettes
        usable: usize,
    },
    /// The grid cannot be created
    #[error("no grid can be created with a voxel size of {voxel_size_mm} mm")]
    VoxelSize {
        /// The option
        voxel_size_mm: f64,
        /// Error of the grid
        source: SurfaceError,
    },
    /// The silhouettes have no point in common
    #[error("the silhouettes have no point in common: check the turn angles and the camera")]
    Empty,
}

/// Minimum angle between lines of sight
///
/// Below, the hull extends along the line of sight to five times the body's depth and more.
const MIN_SPREAD_DEGREES: f64 = 20.0;

/// Share of the camera's distance within which the hull is searched
///
/// People turn on the spot at least a quarter of the distance away from the camera; a larger box would contain the
/// camera itself, where every silhouette is a point.
const MAX_RADIUS_PART: f64 = 0.75;

/// Height up to which the hull is searched, in mm; the tallest person ever measured had 2720
const MAX_HEIGHT_MM: f64 = 3000.0;

/// Field evaluations that refine each vertex: one corrects the error of linear interpolation at the hull's edges
const SECANT_STEPS: usize = 1;

/// Carves the visual hull: its largest piece, closed, manifold and outward oriented, cut off at the floor
///
/// World frame, mm. Outside the borders of a photo no point counts as person, except where the silhouette itself is cut
/// off by the border: there, that view removes nothing. Points outside all photos are not part of the hull. Empty
/// silhouettes are skipped.
///
/// # Errors
/// When fewer than two silhouettes are nonempty, when all are seen from one direction, when an angle, a camera or an
/// option is invalid, or when the hull is empty.
pub fn carve(views: &[CarveView], options: &CarveOptions) -> Result<TriMesh, CarveError> {
    let hull = HullField::new(views, options.misses_to_remove)?;
    extract(&hull, &hull, options)
}

/// Carves the visual hull and removes the phantoms identified by the avatar's own hull from the same views
///
/// The avatar stands in the world frame in the pose of the silhouettes. Only points clearly outside the avatar, but
/// within its hull from these views, are removed: a belly that no silhouette of the avatar covers is kept.
///
/// # Errors
/// Same as [`carve`].
pub fn carve_beside_avatar(
    views: &[CarveView],
    avatar: &Avatar,
    options: &CarveOptions,
) -> Result<TriMesh, CarveError> {
    let hull = HullField::new(views, options.misses_to_remove)?;
    let avatars = phantom::outlines(views, avatar);
    let phantoms = PhantomField::new(views, &avatars, avatar)?;
    let field = WithoutPhantoms {
        hull: &hull,
        phantoms: &phantoms,
    };
    extract(&hull, &field, options)
}

/// A hull minus the phantoms identified by the avatar's own hull
struct WithoutPhantoms<'a> {
    hull: &'a HullField<'a>,
    phantoms: &'a PhantomField<'a>,
}

impl WithoutPhantoms<'_> {
    fn cut(&self, point: DVec3, outside: f64, part: ViewSet) -> f64 {
        // Points outside the hull need no further test.
        if outside > 0.0 || outside.is_nan() {
            return outside;
        }
        outside.max(self.phantoms.value(point, part))
    }
}

impl Field for &WithoutPhantoms<'_> {
    /// Bound of the slope of the hull's and of the avatar's hull's field
    type Part = [ViewSet; 2];

    fn whole(&self) -> Self::Part {
        [ViewSet::ALL; 2]
    }

    fn value(&self, point: DVec3, [own, avatars]: Self::Part) -> f64 {
        self.cut(point, self.hull.value(point, own), avatars)
    }

    fn near(&self, center: DVec3, radius: f64, [own, avatars]: Self::Part) -> (f64, Self::Part) {
        let (outside, own) = self.hull.near(center, radius, own);
        let avatars = (&self.phantoms.hull).near(center, radius, avatars).1;
        (self.cut(center, outside, avatars), [own, avatars])
    }
}

/// Extracts the largest piece of the surface of a field with the slope and size of the hull's
fn extract(
    hull: &HullField,
    field: impl Field,
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
        // Only the largest piece is kept.
        thin_pieces: false,
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

/// Signed distance to the hull: exceeds the true distance at most slightly, zero on its surface
struct HullField<'a> {
    views: Vec<ProjectedView<'a>>,
    misses_to_remove: usize,
    /// Whether a silhouette is cut off by the border of its photo
    any_cut: bool,
    /// Half the edge of the box to search, in mm
    radius_mm: f64,
    /// Bound on the field's slope
    lipschitz: f64,
}

impl<'a> HullField<'a> {
    fn new(views: &[CarveView<'a>], misses_to_remove: usize) -> Result<Self, CarveError> {
        for (index, view) in views.iter().enumerate() {
            check_view(index, view)?;
        }
        let used: Vec<&CarveView> = views.iter().filter(|v| !v.outline.is_empty()).collect();
        let usable = used.len();
        if usable < 2 {
            return Err(CarveError::TooFewViews {
                usable,
                given: views.len(),
            });
        }
        let spread_degrees = direction_spread(used.iter().map(|view| view.turn)).to_degrees();
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
        for view in &used {
            nearest = nearest.min(view.camera.distance_mm);
            lipschitz = lipschitz.max(slope_bound(&view.camera));
        }
        Ok(Self {
            any_cut: used.iter().any(|view| view.outline.is_cut()),
            radius_mm: MAX_RADIUS_PART * nearest,
            lipschitz,
            views: used.into_iter().map(ProjectedView::new).collect(),
            misses_to_remove,
        })
    }

    /// Returns the value at a point, from the given views only
    fn value(&self, point: DVec3, views: ViewSet) -> f64 {
        let mut unseen = f64::INFINITY;
        let mut distance = |view: &ProjectedView| {
            let (to_outline, to_photo) = view.distances(point);
            unseen = unseen.min(to_photo);
            to_outline
        };
        let hull = if self.misses_to_remove == 1 {
            let distances = views.of(&self.views).map(&mut distance);
            distances.fold(f64::NEG_INFINITY, nan_max)
        } else {
            let mut all: Vec<f64> = self.views.iter().map(&mut distance).collect();
            all.sort_unstable_by(|a, b| b.total_cmp(a));
            all[self.misses_to_remove - 1]
        };
        // Fewer views are evaluated only where some photo certainly shows the point.
        let hull = if self.any_cut && views == ViewSet::ALL {
            hull.max(unseen)
        } else {
            hull
        };
        nan_max(hull, -point.y)
    }
}

/// Returns the signed distance at a world point, in mm; negative inside the hull, NaN where a camera cannot project it
impl Field for &HullField<'_> {
    /// Returns the views that can determine the value
    type Part = ViewSet;

    fn whole(&self) -> ViewSet {
        ViewSet::ALL
    }

    fn value(&self, point: DVec3, part: ViewSet) -> f64 {
        HullField::value(self, point, part)
    }

    fn is_inside(&self, point: DVec3, part: ViewSet) -> bool {
        if self.misses_to_remove > 1 {
            return HullField::value(self, point, part) < 0.0;
        }
        let may_be_unseen = self.any_cut && part == ViewSet::ALL;
        // The first view that misses the point decides.
        point.y > 0.0
            && part.of(&self.views).all(|view| view.distance(point) < 0.0)
            && (!may_be_unseen || HullField::value(self, point, part) < 0.0)
    }

    fn values(&self, points: &[DVec3], part: ViewSet, values: &mut [f64]) {
        assert_eq!(points.len(), values.len(), "a value for each point");
        if self.misses_to_remove > 1 || (self.any_cut && part == ViewSet::ALL) {
            for (value, &point) in values.iter_mut().zip(points) {
                *value = HullField::value(self, point, part);
            }
            return;
        }
        // Map by map: nearby reads are close together in memory.
        for (value, point) in values.iter_mut().zip(points) {
            *value = -point.y;
        }
        for view in part.of(&self.views) {
            view.raise(points, values);
        }
    }

    fn near(&self, center: DVec3, radius: f64, of: ViewSet) -> (f64, ViewSet) {
        /// Jump of distances where exact ones end, in px
        const JUMP_PX: f64 = 2.0;
        if self.misses_to_remove > 1 || self.views.len() > ViewSet::MOST {
            return (HullField::value(self, center, of), of);
        }
        let may_be_unseen = self.any_cut && of == ViewSet::ALL;
        let mut distances = [f64::NEG_INFINITY; ViewSet::MOST];
        let (mut largest, mut unseen) = (f64::NEG_INFINITY, f64::INFINITY);
        let (mut nearest, mut mm_per_px) = (f64::INFINITY, 0.0_f64);
        for (view, index) in of.of(&self.views).zip(of.indices()) {
            let (to_outline, to_photo) = view.distances(center);
            distances[index] = to_outline;
            largest = nan_max(largest, to_outline);
            unseen = unseen.min(to_photo);
            let depth = view.depth(center);
            nearest = nearest.min(depth);
            mm_per_px = mm_per_px.max(depth * view.mm_per_px_at_unit_depth);
        }
        let least = largest - 2.0 * self.lipschitz * radius - JUMP_PX * mm_per_px;
        let hull = if may_be_unseen {
            largest.max(unseen)
        } else {
            largest
        };
        let value = nan_max(hull, -center.y);
        // The slope is bounded only well in front of the camera; behind it no bound holds.
        if nearest <= 2.0 * radius || value.is_nan() || (may_be_unseen && unseen >= least) {
            return (value, of);
        }
        (value, of.only(|index| distances[index] >= least))
    }
}

fn check_view(view: usize, given: &CarveView) -> Result<(), CarveError> {
    let CarveView {
        outline,
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
        && camera.pitch_radians.is_finite()
        && camera.yaw_radians.is_finite();
    if !sees {
        return Err(CarveError::Camera {
            view,
            camera: *camera,
        });
    }
    let (width, height) = outline.size_px();
    if (width, height) != (camera.width_px, camera.height_px) {
        return Err(CarveError::Size {
            view,
            width,
            height,
            camera_width: camera.width_px,
            camera_height: camera.height_px,
        });
    }
    Ok(())
}

/// Computes the largest angle between two lines of sight, treating opposite directions as equal
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

/// Bounds the change of a silhouette's distance in mm per mm
///
/// Across the line of sight by 1 / cos of the angle off the optical axis; along it, the distance grows with the depth,
/// which adds 15 % within a quarter of the depth; larger blocks are never skipped.
fn slope_bound(camera: &Camera) -> f64 {
    let corner = DVec2::new(camera.width_px as f64, camera.height_px as f64) / 2.0;
    let stretched = camera.lens().bend_gradient(corner) * corner;
    let stretch = f64::max(stretched.length() / corner.length(), 1.0);
    1.15 * stretch * (corner.length() / camera.focal_px()).hypot(1.0)
}

#[cfg(test)]
mod tests;
