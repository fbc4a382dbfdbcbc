//! From a cut to a silhouette: removal of small artifacts, and subpixel borders.

use pirouette_geom::distance_map::signed_distance_within;
use pirouette_geom::morphology::{dilate, erode, fill_holes_below, largest_component};
use pirouette_geom::{Grid, Mask};

use crate::clean_plate::{CleanPlate, blur};
use crate::seeds::Window;

/// Removes small components, hairs and islands from a mask; `scale` 1 is for a person of about 800 px
///
/// Keeps pixels within `2 scale` px of positions where a disc of that radius fits, then the largest component, and
/// fills holes of fewer than `60 scale^2` px. Larger holes, between the legs or under an arm, remain open.
pub fn clean_mask(mask: &Mask, scale: f64) -> Mask {
    const DISC_PX: f64 = 2.0;
    let fill = |mask: &Mask| fill_small_holes(mask, scale);
    let Some(window) = Window::around(mask, (3.0 * DISC_PX * scale).ceil() as usize + 1) else {
        return mask.clone();
    };
    let part = window.crop(mask);
    let core = erode(&part, DISC_PX * scale);
    if core.bounding_box().is_none() {
        return fill(&largest_component(mask));
    }
    // a disc around the eroded mask gives the opened one; twice its radius gives the pixels near that
    let near = dilate(&core, (2.0 * DISC_PX * scale).max(1.0));
    let kept: Vec<bool> = part
        .as_slice()
        .iter()
        .zip(near.as_slice())
        .map(|(&inside, &near)| inside && near)
        .collect();
    let kept = Mask::from_vec(part.width(), part.height(), kept);
    let mut out = Mask::filled(mask.width(), mask.height(), false);
    window.paste(&fill(&largest_component(&kept)), &mut out);
    out
}

/// Fills holes of fewer than `60 scale^2` px
fn fill_small_holes(mask: &Mask, scale: f64) -> Mask {
    const HOLE_PX: f64 = 60.0;
    fill_holes_below(mask, (HOLE_PX * scale * scale) as usize)
}

/// Estimates the fraction of person in each pixel from the colors on both sides of a mask's border
///
/// A cut counts mixed pixels as person; here the fraction is interpolated from the pixel's color between the local
/// color of the person and that of the background (of the `clean_plate` where available). Where the two are similar,
/// the cut decides. The 0.5 level of the result is the outline. `scale` 1 is for a person of about 800 px.
///
/// # Panics
/// When photo and mask differ in size.
pub fn soft_border(
    photo: &Grid<[u8; 3]>,
    mask: &Mask,
    clean_plate: Option<&CleanPlate>,
    scale: f64,
) -> Grid<f32> {
    assert!(photo.same_size(mask), "photo and mask have the same size");
    /// Half width of the band around the mask's border, in px
    const BAND_PX: f32 = 3.0;
    /// Pixels deeper than this contain one side only, in px
    const PURE_PX: f32 = 2.0;
    /// Standard deviation of the weights of local colors, in px
    const LOCAL_SIGMA_PX: f32 = 2.0;
    /// Minimum distance of two colors for unmixing, in levels
    const MIN_CONTRAST: f32 = 15.0;
    /// Blur without contrast, and final blur, in px
    const HARD_BLUR_PX: f32 = 0.7;
    const FINAL_BLUR_PX: f32 = 0.6;

    // below scale 1 the blur of the camera does not shrink
    let scale = scale.clamp(1.0, 4.0) as f32;
    let (band, pure) = (BAND_PX * scale, PURE_PX * scale);
    let reach = (3.0 * LOCAL_SIGMA_PX * scale).ceil() as usize;
    let mut soft = Grid::filled(mask.width(), mask.height(), 0.0_f32);
    let Some(window) = Window::around(mask, reach + band as usize + 2) else {
        return soft;
    };
    let inside = window.crop(mask);
    let depth = signed_distance_within(&inside, band).map(|d| -d);
    let mut blurred = inside.map(|&v| if v { 1.0 } else { 0.0 });
    blur(&mut blurred, HARD_BLUR_PX);
    let weights: Vec<f32> = (0..=2 * reach)
        .map(|i| {
            let offset = (i as f32 - reach as f32) / (LOCAL_SIGMA_PX * scale);
            (-0.5 * offset * offset).exp()
        })
        .collect();
    let mut part = Grid::filled(window.width, window.height, 0.0_f32);
    for y in 0..window.height {
        for x in 0..window.width {
            let d = depth[(x, y)];
            if d.abs() > band {
                part[(x, y)] = if d > 0.0 { 1.0 } else { 0.0 };
                continue;
            }
            part[(x, y)] = blurred[(x, y)];
            let background = clean_plate.and_then(|p| p.color(window.x0 + x, window.y0 + y));
            let mut person = LocalMean::default();
            let mut behind = LocalMean::default();
            let rows = y.saturating_sub(reach)..(y + reach + 1).min(window.height);
            let columns = x.saturating_sub(reach)..(x + reach + 1).min(window.width);
            for other_y in rows {
                let weight_y = weights[other_y + reach - y];
                let colors = &window.row(photo, other_y)[columns.clone()];
                let depths = &depth.row(other_y)[columns.clone()];
                let weights = &weights[columns.start + reach - x..];
                for ((color, &depth), &weight_x) in colors.iter().zip(depths).zip(weights) {
                    if depth > pure {
                        person.add(*color, weight_x * weight_y);
                    } else if depth < -pure && background.is_none() {
                        behind.add(*color, weight_x * weight_y);
                    }
                }
            }
            let (Some(person), Some(behind)) = (
                person.color(),
                background.map_or_else(|| behind.color(), |b| Some(b.map(f32::from))),
            ) else {
                continue;
            };
            let color = window.row(photo, y)[x].map(f32::from);
            let (mut along, mut length) = (0.0, 0.0);
            for channel in 0..3 {
                let step = person[channel] - behind[channel];
                along += (color[channel] - behind[channel]) * step;
                length += step * step;
            }
            if length > MIN_CONTRAST * MIN_CONTRAST {
                part[(x, y)] = (along / length).clamp(0.0, 1.0);
            }
        }
    }
    blur(&mut part, FINAL_BLUR_PX);
    window.paste(&part, &mut soft);
    soft
}

/// Reduces a soft mask to its largest component, without small holes, and the soft values up to `2 scale` px around
/// it; returns the mask of that component
pub fn clean_soft_mask(soft: &mut Grid<f32>, scale: f64) -> Mask {
    const FRINGE_PX: f64 = 2.0;
    let hard = soft.threshold(0.5);
    let Some(window) = Window::around(&hard, (FRINGE_PX * scale).ceil() as usize + 1) else {
        return hard;
    };
    let part = fill_small_holes(&largest_component(&window.crop(&hard)), scale);
    let near = dilate(&part, (FRINGE_PX * scale).max(1.5));
    let mut tidy = window.crop(soft);
    for ((value, &inside), &near) in tidy
        .as_mut_slice()
        .iter_mut()
        .zip(part.as_slice())
        .zip(near.as_slice())
    {
        if !near {
            *value = 0.0;
        } else if inside {
            // filled holes
            *value = value.max(0.5);
        } else if *value >= 0.5 {
            // another component that almost touches
            *value = 0.499;
        }
    }
    soft.as_mut_slice().fill(0.0);
    window.paste(&tidy, soft);
    let mut mask = Mask::filled(hard.width(), hard.height(), false);
    window.paste(&part, &mut mask);
    mask
}

/// Refines the border of a mask that was computed on a smaller copy of the photo and scaled up
///
/// Like [`soft_border`] with scale 1, from the photo alone: the blur of a photo of any size is a pixel or two.
///
/// # Panics
/// When photo and mask differ in size.
pub fn sharpen_mask(photo: &Grid<[u8; 3]>, mask: &Mask) -> Mask {
    assert!(photo.same_size(mask), "photo and mask have the same size");
    /// Rows per block, whose data fits into the cache
    const ROWS: usize = 64;
    /// Reach of the input of a border pixel, in px: band, local colors beyond it, and blur
    const HALO: usize = 16;
    let (width, height) = (mask.width(), mask.height());
    let mut sharp = Mask::filled(width, height, false);
    let Some((_, top, _, bottom)) = mask.bounding_box() else {
        return sharp;
    };
    let (top, bottom) = (top.saturating_sub(HALO), (bottom + HALO).min(height));
    for from in (top..bottom).step_by(ROWS) {
        let to = (from + ROWS).min(bottom);
        let (first, end) = (from.saturating_sub(HALO), (to + HALO).min(height));
        let part = mask.crop(0, first, width, end - first);
        let colors = photo.crop(0, first, width, end - first);
        let soft = soft_border(&colors, &part, None, 1.0);
        for y in from..to {
            let row = sharp.row_mut(y).iter_mut().zip(soft.row(y - first));
            for (inside, &share) in row {
                *inside = share >= 0.5;
            }
        }
    }
    fill_small_holes(&largest_component(&sharp), 1.0)
}

#[derive(Default)]
struct LocalMean {
    sum: [f32; 3],
    weight: f32,
}

impl LocalMean {
    fn add(&mut self, color: [u8; 3], weight: f32) {
        self.weight += weight;
        for (sum, value) in self.sum.iter_mut().zip(color) {
            *sum += weight * f32::from(value);
        }
    }

    /// `None` when almost nothing was added
    fn color(&self) -> Option<[f32; 3]> {
        /// A nearby pixel of full weight counts 1; below this, only distant pixels contributed
        const MIN_WEIGHT: f32 = 0.02;
        (self.weight > MIN_WEIGHT).then(|| self.sum.map(|s| s / self.weight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cleaning_keeps_large_holes_and_removes_islands() {
        let ring = Grid::from_fn(60, 40, |x, y| {
            let hole = (20..32).contains(&x) && (12..28).contains(&y);
            let pinhole = x == 12 && y == 12;
            let hair = y == 20 && (45..55).contains(&x);
            let island = (55..60).contains(&x) && y < 5;
            ((5..45).contains(&x) && (5..35).contains(&y) && !hole && !pinhole) || hair || island
        });
        let mask = clean_mask(&ring, 1.0);
        assert!(!mask[(25, 20)], "the large hole remains open");
        assert!(mask[(12, 12)], "the pinhole is filled");
        assert!(!mask[(52, 20)], "the hair is removed");
        assert!(!mask[(57, 2)], "the island is removed");
        assert!(mask[(5, 5)], "corners are kept");
    }

    #[test]
    fn cleaning_keeps_a_thin_shape() {
        let line = Mask::from_art("..... ##### .....");
        assert_eq!(clean_mask(&line, 1.0), line);
        let empty = Mask::filled(3, 3, false);
        assert_eq!(clean_mask(&empty, 1.0), empty);
    }

    #[test]
    fn a_mixed_column_gets_its_fraction() {
        let photo = Grid::from_fn(40, 20, |x, _| match x {
            0..20 => [200, 100, 50],
            20 => [80, 70, 65],
            _ => [40, 60, 70],
        });
        // a quarter of column 20 is person, but the mask contains all of it
        let mask = Grid::from_fn(40, 20, |x, y| x <= 20 && (2..18).contains(&y));
        let soft = soft_border(&photo, &mask, None, 1.0);
        assert!(soft[(20, 10)] > 0.15 && soft[(20, 10)] < 0.4);
        assert!(soft[(18, 10)] > 0.95 && soft[(23, 10)] < 0.05);
        assert!(soft.as_slice().iter().all(|v| (0.0..=1.0001).contains(v)));
    }

    #[test]
    fn without_contrast_the_mask_decides() {
        let photo = Grid::filled(30, 30, [90; 3]);
        let mask = Grid::from_fn(30, 30, |x, y| (8..22).contains(&x) && (8..22).contains(&y));
        let soft = soft_border(&photo, &mask, None, 1.0);
        assert_eq!(soft.threshold(0.5), mask);
        let empty = Mask::filled(30, 30, false);
        let soft = soft_border(&photo, &empty, None, 1.0);
        assert!(soft.as_slice().iter().all(|&v| v == 0.0));
    }

    #[test]
    fn a_border_that_was_scaled_up_is_refined() {
        // a disc, photographed with a blur of a pixel, and a mask that is off by up to two pixels
        let inside =
            |x: usize, y: usize, radius: f64| (x as f64 - 70.0).hypot(y as f64 - 75.0) - radius;
        let photo = Grid::from_fn(140, 150, |x, y| {
            let share = (0.5 - inside(x, y, 50.0)).clamp(0.0, 1.0);
            [[190.0, 40.0], [120.0, 60.0], [70.0, 80.0]]
                .map(|[person, behind]| (behind + (person - behind) * share + 0.5) as u8)
        });
        let truth = Grid::from_fn(140, 150, |x, y| inside(x, y, 50.0) < 0.0);
        let coarse = Grid::from_fn(140, 150, |x, y| inside(x - x % 4, y - y % 4, 50.0) < 0.0);
        let found = sharpen_mask(&photo, &coarse);
        assert!(coarse.iou(&truth) < 0.96);
        assert!(found.iou(&truth) > 0.995, "{}", found.iou(&truth));
        // blocks of rows leave no seams
        let whole = soft_border(&photo, &coarse, None, 1.0).threshold(0.5);
        assert_eq!(found, whole);
        let empty = Mask::filled(140, 150, false);
        assert_eq!(sharpen_mask(&photo, &empty), empty);
    }

    #[test]
    fn cleaning_a_soft_mask_removes_separate_components() {
        let mut soft = Grid::from_fn(20, 6, |x, _| match x {
            0..8 => 1.0,
            8 => 0.3,
            14..16 => 0.8,
            _ => 0.0,
        });
        let mask = clean_soft_mask(&mut soft, 1.0);
        assert_eq!(mask.area(), 48);
        assert_eq!(soft[(8, 3)], 0.3);
        assert_eq!(soft[(14, 3)], 0.0);
    }
}
