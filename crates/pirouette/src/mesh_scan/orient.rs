//! Unit, up axis and front of a body mesh.

use glam::{DMat3, DVec3};
use pirouette_geom::TriMesh;

use super::MeshScanError;

/// Unit of the coordinates of a mesh
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshUnit {
    /// Millimeters
    Millimeter,
    /// Centimeters
    Centimeter,
    /// Meters
    Meter,
    /// Inches
    Inch,
}

impl MeshUnit {
    /// Returns the length of the unit, in mm
    pub fn mm(self) -> f64 {
        match self {
            MeshUnit::Millimeter => 1.0,
            MeshUnit::Centimeter => 10.0,
            MeshUnit::Meter => 1000.0,
            MeshUnit::Inch => 25.4,
        }
    }

    /// Returns the unit in which this is the height of a person; `None` if there is no such unit
    fn of_height(height: f64) -> Option<Self> {
        match height {
            0.5..2.6 => Some(MeshUnit::Meter),
            20.0..90.0 => Some(MeshUnit::Inch),
            90.0..260.0 => Some(MeshUnit::Centimeter),
            500.0..2600.0 => Some(MeshUnit::Millimeter),
            _ => None,
        }
    }
}

/// Direction of an axis of a mesh
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum AxisDirection {
    X,
    NegX,
    Y,
    NegY,
    Z,
    NegZ,
}

impl AxisDirection {
    const ALL: [AxisDirection; 6] = [
        AxisDirection::Y,
        AxisDirection::Z,
        AxisDirection::X,
        AxisDirection::NegY,
        AxisDirection::NegZ,
        AxisDirection::NegX,
    ];

    fn vector(self) -> DVec3 {
        match self {
            AxisDirection::X => DVec3::X,
            AxisDirection::NegX => DVec3::NEG_X,
            AxisDirection::Y => DVec3::Y,
            AxisDirection::NegY => DVec3::NEG_Y,
            AxisDirection::Z => DVec3::Z,
            AxisDirection::NegZ => DVec3::NEG_Z,
        }
    }
}

/// An upright axis is at least this long, relative to the longest
const UPRIGHT_EXTENT: f64 = 0.7;

/// Ratio of the area of trunk and arms to that of the legs which shows the upright axis: 1.4 to 2.6 on people, 1 across
/// stretched arms, and more obliquely across them
const TRUNK_RATIO: std::ops::Range<f64> = 1.15..4.0;

/// Parts of the height in which trunk and arms are compared with the legs: mirrored, so that both are equal across
/// stretched arms
const TRUNK_BAND: [f64; 2] = [0.68, 0.90];
const LEG_BAND: [f64; 2] = [0.10, 0.32];

/// Parts of the height that contain toes, and only heels and ankles
const TOE_BAND: [f64; 2] = [0.0, 0.025];
const ANKLE_BAND: [f64; 2] = [0.05, 0.09];

/// Distance of the toes' middle before that of the ankles, relative to the height: 0.02 to 0.03 on people
const MIN_TOES_AHEAD: f64 = 0.006;

/// Cosine of the angle below which a given front is contradicted by the feet
const AWAY: f64 = -0.5;

/// Returns the mesh in the world frame, in mm: upright, facing +z, on the floor, the trunk above the origin
///
/// Trunk and arms have more surface than the legs, which determines the up axis; toes point to the front.
pub(super) fn upright(
    mesh: &TriMesh,
    unit: Option<MeshUnit>,
    up: Option<AxisDirection>,
    front: Option<AxisDirection>,
) -> Result<TriMesh, MeshScanError> {
    let pieces = Pieces::new(mesh);
    let up = match up {
        Some(up) => up.vector(),
        None => pieces.up().ok_or(MeshScanError::UpUnknown)?,
    };
    let heights = pieces.heights(up);
    let [low, high] = heights.bounds.ok_or(MeshScanError::Empty)?;
    let height = high - low;
    let unit = unit
        .or_else(|| MeshUnit::of_height(height))
        .ok_or(MeshScanError::UnitUnknown { height })?;
    let height_mm = height * unit.mm();
    if !(500.0..2600.0).contains(&height_mm) {
        return Err(MeshScanError::Height { height_mm });
    }
    let found = pieces.front(&heights, up);
    let front = match (front.map(AxisDirection::vector), found) {
        // The silhouettes of a person from behind would be fitted, too.
        (Some(front), Some(found)) if found.dot(front) < AWAY => {
            return Err(MeshScanError::FrontContradicted);
        }
        (Some(front), _) => front,
        (None, found) => found.ok_or(MeshScanError::FrontUnknown)?,
    };
    // Both are unit vectors, so this is near 1 unless they are the same axis.
    let right = up.cross(front);
    let right = right.try_normalize().ok_or(MeshScanError::FrontUnknown)?;
    let world_from_mesh = DMat3::from_cols(right, up, front).transpose() * unit.mm();
    let trunk = pieces.middle(&heights, TRUNK_BAND).unwrap_or_default();
    let origin = trunk - up * (trunk.dot(up) - low);
    let positions = mesh.positions.iter();
    Ok(TriMesh {
        positions: positions.map(|&p| world_from_mesh * (p - origin)).collect(),
        triangles: mesh.triangles.clone(),
    })
}

/// The middles of the triangles with their areas
struct Pieces(Vec<(DVec3, f64)>);

/// The heights of all pieces along an axis
struct Heights {
    /// Of each piece
    of: Vec<f64>,
    /// Lowest and highest; `None` without an extent
    bounds: Option<[f64; 2]>,
}

impl Heights {
    /// Returns whether a piece lies within a part of the height
    fn within(&self, piece: usize, [from, to]: [f64; 2]) -> bool {
        self.bounds.is_some_and(|[low, high]| {
            (from..to).contains(&((self.of[piece] - low) / (high - low)))
        })
    }
}

impl Pieces {
    fn new(mesh: &TriMesh) -> Self {
        let pieces = (0..mesh.triangles.len()).map(|t| {
            let [a, b, c] = mesh.corners(t);
            ((a + b + c) / 3.0, (b - a).cross(c - a).length() / 2.0)
        });
        Self(
            pieces
                .filter(|(p, area)| p.is_finite() && *area > 0.0)
                .collect(),
        )
    }

    fn heights(&self, up: DVec3) -> Heights {
        let of: Vec<f64> = self.0.iter().map(|(p, _)| p.dot(up)).collect();
        let low = of.iter().copied().fold(f64::INFINITY, f64::min);
        let high = of.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Heights {
            of,
            bounds: (high > low).then_some([low, high]),
        }
    }

    fn area(&self, heights: &Heights, band: [f64; 2]) -> f64 {
        let pieces = self.0.iter().enumerate();
        pieces
            .filter(|(i, _)| heights.within(*i, band))
            .map(|(_, (_, area))| area)
            .sum()
    }

    /// Returns the middle of the surface within a part of the height
    fn middle(&self, heights: &Heights, band: [f64; 2]) -> Option<DVec3> {
        let (mut sum, mut total) = (DVec3::ZERO, 0.0);
        for (i, (p, area)) in self.0.iter().enumerate() {
            if heights.within(i, band) {
                sum += *p * *area;
                total += area;
            }
        }
        (total > 0.0).then(|| sum / total)
    }

    fn up(&self) -> Option<DVec3> {
        let candidates = AxisDirection::ALL.map(|axis| {
            let heights = self.heights(axis.vector());
            let extent = heights.bounds.map_or(0.0, |[low, high]| high - low);
            (axis, heights, extent)
        });
        let longest = candidates
            .iter()
            .map(|(_, _, extent)| *extent)
            .fold(0.0, f64::max);
        let ratios = candidates
            .into_iter()
            .filter(|(_, _, extent)| *extent >= UPRIGHT_EXTENT * longest)
            .map(|(axis, heights, _)| {
                let [trunk, legs] = [TRUNK_BAND, LEG_BAND].map(|band| self.area(&heights, band));
                (axis, trunk / legs)
            });
        let ratios: Vec<(AxisDirection, f64)> = ratios.collect();
        let plausible = ratios
            .iter()
            .filter(|(_, ratio)| TRUNK_RATIO.contains(ratio));
        let best = plausible.max_by(|a, b| a.1.total_cmp(&b.1));
        // Wide skirts hide the difference: then the most usual axis counts, and the fit is refused if that is wrong.
        best.or(ratios.first()).map(|(axis, _)| axis.vector())
    }

    /// Returns the horizontal direction in which the toes point, across the widest direction of trunk and arms
    fn front(&self, heights: &Heights, up: DVec3) -> Option<DVec3> {
        let middle = self.middle(heights, TRUNK_BAND)?;
        let across = up.any_orthonormal_vector();
        let other = up.cross(across);
        // Second moments of trunk and arms in the horizontal plane
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (i, (p, area)) in self.0.iter().enumerate() {
            if heights.within(i, TRUNK_BAND) {
                let (x, y) = ((*p - middle).dot(across), (*p - middle).dot(other));
                xx += area * x * x;
                xy += area * x * y;
                yy += area * y * y;
            }
        }
        let angle = (2.0 * xy).atan2(xx - yy) / 2.0;
        let widest = across * angle.cos() + other * angle.sin();
        let front = widest.cross(up);
        let [toes, ankles] = [TOE_BAND, ANKLE_BAND].map(|band| self.middle(heights, band));
        let [low, high] = heights.bounds?;
        let ahead = (toes? - ankles?).dot(front) / (high - low);
        (ahead.abs() > MIN_TOES_AHEAD).then(|| front * ahead.signum())
    }
}
