//! Photos and regions of photos

use thiserror::Error;

/// Largest accepted width and height of a photo, in px
const MAX_SIDE: usize = 32768;

/// Pixels of a photo, borrowed
#[derive(Clone, Copy, Debug)]
pub struct Photo<'a> {
    width: usize,
    height: usize,
    pixels: &'a [[u8; 3]],
}

/// Reason why [`Photo::new`] rejects pixels
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PhotoError {
    /// A side is zero or too long
    #[error("a photo of {width} x {height} px is not supported: each side must have 1 to 32768 px")]
    Size {
        /// Width, in px
        width: usize,
        /// Height, in px
        height: usize,
    },
    /// The number of pixels is not width times height
    #[error("a photo of {width} x {height} px requires {} pixels, {found} given", .width * .height)]
    PixelCount {
        /// Width, in px
        width: usize,
        /// Height, in px
        height: usize,
        /// Number of given pixels
        found: usize,
    },
}

impl<'a> Photo<'a> {
    /// Borrows pixels: red, green and blue in sRGB, row by row from the top left.
    ///
    /// # Errors
    /// If a side is zero or above 32768 px, or the number of pixels is not `width * height`.
    pub fn new(width: usize, height: usize, pixels: &'a [[u8; 3]]) -> Result<Self, PhotoError> {
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            return Err(PhotoError::Size { width, height });
        }
        if pixels.len() != width * height {
            return Err(PhotoError::PixelCount {
                width,
                height,
                found: pixels.len(),
            });
        }
        Ok(Self {
            width,
            height,
            pixels,
        })
    }

    /// Width, in px
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, in px
    pub fn height(&self) -> usize {
        self.height
    }

    /// Pixels, row by row from the top left
    pub fn pixels(&self) -> &'a [[u8; 3]] {
        self.pixels
    }
}

/// Rotated square in a photo, in px: x right, y down
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    center: [f64; 2],
    size: f64,
    turn: f64,
    /// Whether its left border is on the right
    mirrored: bool,
}

impl Region {
    /// Largest size, and largest distance of the center from the photo's corner, in px
    pub const MAX_SIZE: f64 = 1e6;

    /// Distance of the centers from which two regions show different persons, relative to the larger size
    const ELSEWHERE: f64 = 0.25;

    /// Creates a square of edge length `size` px, rotated by `turn` radians, clockwise on the screen.
    ///
    /// Returns `None` unless all values are finite, `size` is positive and at most [`Self::MAX_SIZE`], and so are the
    /// magnitudes of the center's coordinates.
    pub fn new(center: [f64; 2], size: f64, turn: f64) -> Option<Self> {
        let valid = size > 0.0 && size <= Self::MAX_SIZE && turn.is_finite();
        (valid && center.iter().all(|v| v.abs() <= Self::MAX_SIZE)).then_some(Self {
            center,
            size,
            turn,
            mirrored: false,
        })
    }

    /// Smallest upright square about the center of a photo that contains the photo
    pub fn containing(photo: &Photo) -> Self {
        let (width, height) = (photo.width as f64, photo.height as f64);
        Self {
            center: [width / 2.0, height / 2.0],
            size: width.max(height),
            turn: 0.0,
            mirrored: false,
        }
    }

    /// The same square with left and right exchanged: the network sees the person as in a mirror
    pub(crate) fn mirror_image(self) -> Self {
        Self {
            mirrored: !self.mirrored,
            ..self
        }
    }

    /// Upright square
    pub(crate) fn upright(center: [f64; 2], size: f64) -> Option<Self> {
        Self::new(center, size, 0.0)
    }

    /// Square about `center` whose circle through `top`, above the person's head, has a quarter of margin.
    ///
    /// # Source
    /// MediaPipe, `pose_landmarks_to_roi.pbtxt`: `AlignmentPointsRectsCalculator`, scale 1.25
    pub(crate) fn around(center: [f64; 2], top: [f64; 2]) -> Option<Self> {
        let (dx, dy) = (top[0] - center[0], top[1] - center[1]);
        let turn = std::f64::consts::FRAC_PI_2 - (-dy).atan2(dx);
        Self::new(center, 2.5 * dx.hypot(dy), turn)
    }

    /// Center, in px
    pub fn center(&self) -> [f64; 2] {
        self.center
    }

    /// Edge length, in px
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Rotation, in radians, clockwise on the screen
    pub fn turn(&self) -> f64 {
        self.turn
    }

    /// Returns whether two regions are so far apart that they show different persons.
    ///
    /// The size of a region is about 1.3 times the stature. Who turns on the spot moves by less than a tenth of it.
    pub fn is_elsewhere(&self, other: &Self) -> bool {
        let [dx, dy] = std::array::from_fn(|axis| self.center[axis] - other.center[axis]);
        dx.hypot(dy) > Self::ELSEWHERE * self.size.max(other.size)
    }

    /// Converts a position in the region, (0, 0) at its top left and (1, 1) at its bottom right corner, to px of the
    /// photo.
    pub fn photo_from_unit(&self, unit: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.turn.sin_cos();
        let [x, y] = unit.map(|v| (v - 0.5) * self.size);
        let x = if self.mirrored { -x } else { x };
        [
            self.center[0] + cos * x - sin * y,
            self.center[1] + sin * x + cos * y,
        ]
    }

    /// Inverse of [`Self::photo_from_unit`]
    pub fn unit_from_photo(&self, position: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.turn.sin_cos();
        let (dx, dy) = (position[0] - self.center[0], position[1] - self.center[1]);
        let x = (cos * dx + sin * dy) / self.size;
        [
            if self.mirrored { 0.5 - x } else { 0.5 + x },
            (cos * dy - sin * dx) / self.size + 0.5,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::{Photo, PhotoError, Region};

    #[test]
    fn photo_rejects_other_numbers_of_pixels() {
        assert!(Photo::new(2, 1, &[[0; 3]; 2]).is_ok());
        assert_eq!(
            Photo::new(0, 1, &[]).unwrap_err(),
            PhotoError::Size {
                width: 0,
                height: 1
            }
        );
        let error = Photo::new(2, 2, &[[0; 3]; 2]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "a photo of 2 x 2 px requires 4 pixels, 2 given"
        );
    }

    #[test]
    fn region_rejects_values_that_are_not_finite() {
        assert!(Region::new([0.0; 2], 1.0, 0.0).is_some());
        for (x, size, turn) in [
            (f64::NAN, 1.0, 0.0),
            (0.0, 0.0, 0.0),
            (0.0, f64::INFINITY, 0.0),
            (0.0, 1.0, f64::NAN),
        ] {
            assert!(Region::new([x, 0.0], size, turn).is_none());
        }
    }

    #[test]
    fn regions_of_different_persons_are_a_quarter_of_their_size_apart() {
        let at = |x: f64, size: f64| Region::new([x, 50.0], size, 0.0).unwrap();
        assert!(!at(100.0, 200.0).is_elsewhere(&at(149.0, 150.0)));
        assert!(at(100.0, 200.0).is_elsewhere(&at(151.0, 150.0)));
        assert!(at(151.0, 150.0).is_elsewhere(&at(100.0, 200.0)));
    }

    #[test]
    fn mirror_image_exchanges_left_and_right() {
        let region = Region::new([50.0, 60.0], 40.0, 0.3).unwrap();
        let mirrored = region.mirror_image();
        for [x, y] in [[0.0, 0.0], [0.2, 0.9], [1.0, 0.5]] {
            let position = mirrored.photo_from_unit([x, y]);
            let straight = region.photo_from_unit([1.0 - x, y]);
            assert!((0..2).all(|i| (position[i] - straight[i]).abs() < 1e-12));
            let unit = mirrored.unit_from_photo(position);
            assert!((unit[0] - x).abs() < 1e-12 && (unit[1] - y).abs() < 1e-12);
        }
        assert_eq!(mirrored.mirror_image(), region);
    }

    #[test]
    fn region_around_hips_is_upright_along_the_body() {
        let region = Region::around([50.0, 60.0], [90.0, 60.0]).unwrap();
        assert_eq!(region.size(), 100.0);
        // The person lies with the head to the right, so the region's top is on the right.
        let top = region.photo_from_unit([0.5, 0.0]);
        assert!((top[0] - 100.0).abs() < 1e-9 && (top[1] - 60.0).abs() < 1e-9);
        let unit = region.unit_from_photo(top);
        assert!((unit[0] - 0.5).abs() < 1e-9 && unit[1].abs() < 1e-9);
    }
}
