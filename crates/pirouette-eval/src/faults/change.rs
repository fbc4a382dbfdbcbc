//! Changes of photos, keypoints and masks that faults are made of.

use glam::DVec2;
use pirouette::scan::{Photo, Scan, View};
use pirouette_body::{Joint, Keypoint};
use pirouette_geom::{Grid, Mask};

/// Applies a map to the positions of all keypoints that were found
pub(super) fn move_keypoints(view: &mut View, mut map: impl FnMut(DVec2) -> DVec2) {
    for joint in Joint::ALL {
        let mut keypoint = view.keypoints.get(joint);
        if keypoint.confidence > 0.0 {
            keypoint.position = map(keypoint.position);
            view.keypoints.set(joint, keypoint);
        }
    }
}

/// Marks keypoints outside the photo as not found: no detector reports them
pub(super) fn drop_outside(view: &mut View) {
    let size = DVec2::new(view.photo.width() as f64, view.photo.height() as f64);
    for joint in Joint::ALL {
        let at = view.keypoints.get(joint).position;
        let inside = at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all();
        if !inside {
            view.keypoints.set(joint, Keypoint::default());
        }
    }
}

/// Edges that are cut off a photo, in px
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Edges {
    pub(super) left: usize,
    pub(super) right: usize,
    pub(super) top: usize,
    pub(super) bottom: usize,
}

/// Crops all photos with their keypoints and masks; at least one pixel remains
pub(super) fn crop(scan: &mut Scan, edges: Edges) {
    for view in &mut scan.views {
        let (width, height) = (view.photo.width(), view.photo.height());
        let left = edges.left.min(width.saturating_sub(1));
        let top = edges.top.min(height.saturating_sub(1));
        let columns = width.saturating_sub(left + edges.right).max(1);
        let rows = height.saturating_sub(top + edges.bottom).max(1);
        view.photo = view.photo.crop(left, top, columns, rows);
        view.mask = view
            .mask
            .as_ref()
            .map(|mask| mask.crop(left, top, columns, rows));
        view.input_size_px = (columns, rows);
        move_keypoints(view, |at| at - DVec2::new(left as f64, top as f64));
        drop_outside(view);
    }
}

/// Appends rows that repeat the last one to all photos; those of masks are empty
pub(super) fn pad_below(scan: &mut Scan, rows: usize) {
    for view in &mut scan.views {
        let (width, height) = (view.photo.width(), view.photo.height());
        let photo = &view.photo;
        let padded = Photo::from_fn(width, height + rows, |x, y| photo[(x, y.min(height - 1))]);
        view.photo = padded;
        view.mask = view
            .mask
            .as_ref()
            .map(|mask| Mask::from_fn(width, height + rows, |x, y| y < height && mask[(x, y)]));
        view.input_size_px = (width, height + rows);
    }
}

/// A continuous map of the pixels of a photo to a photo of the same size, relative to its middle
pub(super) struct Warp<F, B> {
    /// From the given photo to the new one
    pub(super) new_from_given: F,
    /// Its inverse
    pub(super) given_from_new: B,
}

/// Warps a view with its keypoints and mask; pixels from outside the photo repeat its border
pub(super) fn warp(view: &mut View, warp: &Warp<impl Fn(DVec2) -> DVec2, impl Fn(DVec2) -> DVec2>) {
    let (width, height) = (view.photo.width(), view.photo.height());
    let middle = DVec2::new(width as f64, height as f64) / 2.0;
    let source = |x: usize, y: usize| {
        let new = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        (warp.given_from_new)(new - middle) + middle
    };
    let photo = &view.photo;
    view.photo = Photo::from_fn(width, height, |x, y| sample(photo, source(x, y)));
    view.mask = view.mask.as_ref().map(|mask| {
        Mask::from_fn(width, height, |x, y| {
            let at = source(x, y).floor();
            mask.get(at.x as isize, at.y as isize)
                .is_some_and(|&inside| inside)
        })
    });
    move_keypoints(view, |at| (warp.new_from_given)(at - middle) + middle);
    drop_outside(view);
}

/// Interpolates a photo bilinearly at a position in px; the border is repeated outside
pub(super) fn sample(photo: &Photo, at: DVec2) -> [u8; 3] {
    let last = DVec2::new(photo.width() as f64 - 1.0, photo.height() as f64 - 1.0);
    let at = (at - 0.5).clamp(DVec2::ZERO, last.max(DVec2::ZERO));
    let (x0, y0) = (at.x as usize, at.y as usize);
    let (x1, y1) = ((x0 + 1).min(last.x as usize), (y0 + 1).min(last.y as usize));
    let (u, v) = (at.x.fract(), at.y.fract());
    std::array::from_fn(|c| {
        let level = |x, y| f64::from(photo[(x, y)][c]);
        let above = level(x0, y0) * (1.0 - u) + level(x1, y0) * u;
        let below = level(x0, y1) * (1.0 - u) + level(x1, y1) * u;
        (above * (1.0 - v) + below * v).round() as u8
    })
}

/// Blurs a photo by a Gaussian of a standard deviation in px
pub(super) fn blur(photo: &Photo, sigma_px: f64) -> Photo {
    let reach = (3.0 * sigma_px).ceil() as usize;
    let weights: Vec<f32> = (0..=2 * reach)
        .map(|i| (-0.5 * ((i as f64 - reach as f64) / sigma_px).powi(2)).exp() as f32)
        .collect();
    let total: f32 = weights.iter().sum();
    let weights: Vec<f32> = weights.iter().map(|w| w / total).collect();
    let levels: Grid<[f32; 3]> = photo.map(|color| color.map(f32::from));
    // Each pass blurs the rows and transposes.
    let pass = |grid: &Grid<[f32; 3]>| {
        let last = grid.width() - 1;
        Grid::from_fn(grid.height(), grid.width(), |y, x| {
            let row = grid.row(y);
            let mut sum = [0.0; 3];
            for (i, weight) in weights.iter().enumerate() {
                let color = row[(x + i).saturating_sub(reach).min(last)];
                for (s, level) in sum.iter_mut().zip(color) {
                    *s += weight * level;
                }
            }
            sum
        })
    };
    pass(&pass(&levels)).map(|color| color.map(|level| level.round().clamp(0.0, 255.0) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_synthetic::people::turning_woman;

    fn gray(levels: &[u8]) -> Photo {
        Photo::from_vec(levels.len(), 1, levels.iter().map(|&v| [v; 3]).collect())
    }

    #[test]
    fn a_sample_between_two_pixels_is_their_mean() {
        let photo = gray(&[10, 30, 90]);
        assert_eq!(sample(&photo, DVec2::new(0.5, 0.5)), [10; 3]);
        assert_eq!(sample(&photo, DVec2::new(1.0, 0.5)), [20; 3]);
        assert_eq!(sample(&photo, DVec2::new(9.0, 0.5)), [90; 3]);
    }

    #[test]
    fn a_blur_keeps_the_sum_and_spreads_a_point() {
        let mut photo = Photo::filled(9, 9, [0; 3]);
        photo[(4, 4)] = [255; 3];
        let blurred = blur(&photo, 1.0);
        assert_eq!(blurred[(3, 4)], blurred[(4, 5)]);
        // 255 / (2 pi)
        assert!(
            (39..=42).contains(&blurred[(4, 4)][0]),
            "{:?}",
            blurred[(4, 4)]
        );
        assert_eq!(blur(&gray(&[7; 5]), 2.0), gray(&[7; 5]));
    }

    #[test]
    fn a_crop_moves_pixels_and_keypoints() {
        let mut scan = turning_woman(3).scan;
        let given = scan.views[0].clone();
        let edges = Edges {
            left: 10,
            top: 5,
            ..Edges::default()
        };
        crop(&mut scan, edges);
        let cropped = &scan.views[0];
        assert_eq!((cropped.photo.width(), cropped.photo.height()), (190, 245));
        assert_eq!(cropped.photo[(50, 50)], given.photo[(60, 55)]);
        let at = |view: &View| view.keypoints.get(Joint::Nose).position;
        assert_eq!(at(cropped), at(&given) - DVec2::new(10.0, 5.0));
    }

    #[test]
    fn keypoints_outside_a_crop_are_not_found() {
        let mut scan = turning_woman(3).scan;
        let edges = Edges {
            bottom: 125,
            ..Edges::default()
        };
        crop(&mut scan, edges);
        let keypoints = &scan.views[0].keypoints;
        assert!(keypoints.found(Joint::Nose).is_some());
        assert_eq!(keypoints.found(Joint::LeftAnkle), None);
    }

    #[test]
    fn padding_moves_nothing() {
        let mut scan = turning_woman(3).scan;
        let given = scan.views[1].clone();
        pad_below(&mut scan, 20);
        let padded = &scan.views[1];
        assert_eq!(padded.photo.height(), 270);
        assert_eq!(padded.photo[(7, 260)], given.photo[(7, 249)]);
        assert_eq!(padded.keypoints, given.keypoints);
    }
}
