//! From the outputs of the network to landmarks

use crate::Region;
use crate::kernels::Shape;
use crate::kernels::elementwise::logistic;

/// Number of landmarks of a person
pub const LANDMARK_COUNT: usize = 33;
/// Landmarks of the network: those of the person, two that define the next region, and four that are not used
pub(crate) const NETWORK_LANDMARKS: usize = 39;
/// Values per landmark: x, y, depth, visibility, presence
pub(crate) const VALUES: usize = 5;

/// Distance from the central cell of a heat map up to which cells contribute to the refined position, in cells
///
/// # Source
/// MediaPipe, `pose_landmark_by_roi_cpu.pbtxt`: `RefineLandmarksFromHeatmapCalculator`, kernel size 7
const REFINEMENT_RADIUS: usize = 3;
/// Smallest maximum of these cells from which positions are refined; the same source
const MIN_REFINEMENT_CONFIDENCE: f32 = 0.5;

/// Point of the body found in a photo
///
/// The order of the points is that of MediaPipe: nose, left inner eye, left eye, left outer eye, right inner eye, right
/// eye, right outer eye, left ear, right ear, left and right mouth corner, shoulders, elbows, wrists, little fingers,
/// index fingers, thumbs, hips, knees, ankles, heels and toes; left before right, as the person's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landmark {
    /// Position, in px of the photo: x right, y down, as MediaPipe reports it
    pub position: [f64; 2],
    /// Depth relative to the hips, in px of the photo, negative toward the camera; less accurate than the position
    pub depth: f64,
    /// Estimated probability that the point is inside the photo and not hidden, 0 to 1
    pub visibility: f64,
    /// Estimated probability that the point is inside the region, 0 to 1
    pub presence: f64,
}

/// Landmarks decoded from one run of the network
#[derive(Clone, Debug)]
pub(crate) struct Decoded {
    pub(crate) landmarks: [Landmark; LANDMARK_COUNT],
    /// Region of the same person, `None` if the landmarks that define it are not finite
    pub(crate) next_region: Option<Region>,
}

/// Decodes [`NETWORK_LANDMARKS`] times [`VALUES`] values, refined by the heat maps.
///
/// `side` is the width and height of the network's input, in px.
pub(crate) fn decode(
    values: &[f32],
    heat: &[f32],
    heat_shape: Shape,
    side: usize,
    region: &Region,
) -> Decoded {
    let side = side as f32;
    let unit = |i: usize| -> [f64; 2] {
        let v = &values[i * VALUES..];
        refine([v[0] / side, v[1] / side], heat, heat_shape, i).map(f64::from)
    };
    let landmark = |i: usize| {
        let v = &values[i * VALUES..];
        Landmark {
            position: region.photo_from_unit(unit(i)),
            depth: f64::from(v[2] / side) * region.size(),
            visibility: f64::from(logistic(v[3])),
            presence: f64::from(logistic(v[4])),
        }
    };
    let [center, top] =
        [LANDMARK_COUNT, LANDMARK_COUNT + 1].map(|i| region.photo_from_unit(unit(i)));
    Decoded {
        landmarks: std::array::from_fn(landmark),
        next_region: Region::around(center, top),
    }
}

/// Replaces a position by the center of mass of the heat map around it, if a cell there is confident enough.
fn refine(unit: [f32; 2], heat: &[f32], shape: Shape, channel: usize) -> [f32; 2] {
    let (width, height) = (shape.width as f32, shape.height as f32);
    let (x, y) = (unit[0] * width, unit[1] * height);
    // Truncated toward zero as in the source: positions up to one cell beyond the border count as inside.
    if !(x > -1.0 && y > -1.0 && x < width && y < height) {
        return unit;
    }
    let (column, row) = (x as usize, y as usize);
    let (mut sum, mut sum_x, mut sum_y, mut max) = (0.0, 0.0, 0.0, 0.0f32);
    for row in
        row.saturating_sub(REFINEMENT_RADIUS)..(row + REFINEMENT_RADIUS + 1).min(shape.height)
    {
        for column in column.saturating_sub(REFINEMENT_RADIUS)
            ..(column + REFINEMENT_RADIUS + 1).min(shape.width)
        {
            let confidence =
                logistic(heat[(row * shape.width + column) * shape.channels + channel]);
            sum += confidence;
            sum_x += column as f32 * confidence;
            sum_y += row as f32 * confidence;
            max = max.max(confidence);
        }
    }
    if max >= MIN_REFINEMENT_CONFIDENCE {
        [sum_x / sum / width, sum_y / sum / height]
    } else {
        unit
    }
}

#[cfg(test)]
mod tests {
    use super::refine;
    use crate::kernels::Shape;

    const SHAPE: Shape = Shape {
        height: 8,
        width: 8,
        channels: 2,
    };

    #[test]
    fn refine_returns_the_center_of_mass_of_confident_cells() {
        let mut heat = [-30.0; 128];
        heat[(3 * 8 + 4) * 2 + 1] = 30.0;
        heat[(3 * 8 + 5) * 2 + 1] = 30.0;
        let [x, y] = refine([0.3, 0.3], &heat, SHAPE, 1);
        assert!(
            (x - 4.5 / 8.0).abs() < 1e-5 && (y - 3.0 / 8.0).abs() < 1e-5,
            "{x} {y}"
        );
        assert_eq!(refine([0.3, 0.3], &heat, SHAPE, 0), [0.3, 0.3]);
    }

    #[test]
    fn refine_keeps_positions_outside_the_map_or_not_finite() {
        for unit in [[-1.0, 0.5], [0.5, 1.0], [f32::INFINITY, 0.5]] {
            assert_eq!(refine(unit, &[30.0; 128], SHAPE, 0), unit);
        }
        assert!(refine([f32::NAN, 0.5], &[30.0; 128], SHAPE, 0)[0].is_nan());
        assert_eq!(refine([0.5, 0.5], &[f32::NAN; 128], SHAPE, 0), [0.5, 0.5]);
    }
}
