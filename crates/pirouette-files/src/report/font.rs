//! Anti-aliased text of any size.
//!
//! The font is DejaVu Sans Condensed: Latin, Greek, Cyrillic and measurement signs, designed for screens, and narrow
//! enough for the titles of tiles. Characters without a glyph become U+FFFD. There is no shaping: combining marks are
//! drawn over the letter, right-to-left scripts are not reordered.

use std::collections::HashMap;
use std::ops::Range;

use ab_glyph::{Font, FontRef, GlyphId, PxScale, ScaleFont, point};
use pirouette::scan::Photo;
use pirouette_geom::Grid;

use super::canvas::{Color, mix};

/// Replacement for characters without a glyph
const REPLACEMENT: char = '\u{fffd}';

/// Marks the position where a text was shortened
pub(super) const ELLIPSIS: char = '…';

/// Number of horizontal glyph offsets within a pixel that are rasterized separately
///
/// With one, the letters of small text are spaced unevenly; more than four make no visible difference.
const SUBPIXELS: f32 = 4.0;

/// Height of capital letters, relative to the size of the text
const CAPITAL_HEIGHT: f32 = 0.729;

/// Smallest and largest size of text, in px
const SIZES_PX: (f32, f32) = (4.0, 400.0);

/// Text of one size, with a cache of glyph rasters
pub(super) struct Lettering {
    font: FontRef<'static>,
    size_px: f32,
    scale: PxScale,
    /// Rows above the baseline
    ascent_px: usize,
    descent_px: usize,
    rasters: HashMap<RasterKey, Option<Raster>>,
}

/// A glyph and its offset within a pixel, in units of 1 / [`SUBPIXELS`]
type RasterKey = (GlyphId, u8);

/// The coverage of a glyph, cropped to the columns and rows with ink
struct Raster {
    /// First column, relative to the pixel of the pen
    left: i32,
    /// First row, relative to the baseline
    top: i32,
    coverage: Grid<u8>,
}

/// A line of text with positioned glyphs
struct SetLine {
    /// Rasters and the columns of their pens, from the first column with ink
    glyphs: Vec<(RasterKey, i32)>,
    /// Columns from the first with ink to the last
    width: usize,
}

impl Lettering {
    /// Creates text whose em square has this size, in px; capital letters have three quarters of it
    pub(super) fn new(size_px: f64) -> Self {
        let font = FontRef::try_from_slice(dejavu::sans_condensed::regular())
            .expect("the embedded font is valid");
        // `max` first: it replaces NaN.
        let size_px = (size_px as f32).max(SIZES_PX.0).min(SIZES_PX.1);
        let em = font.units_per_em().unwrap_or(font.height_unscaled());
        let scale = PxScale::from(size_px * font.height_unscaled() / em);
        let scaled = font.as_scaled(scale);
        let (ascent_px, descent_px) = (scaled.ascent().ceil(), (-scaled.descent()).ceil());
        Self {
            font,
            size_px,
            scale,
            ascent_px: ascent_px as usize,
            descent_px: descent_px as usize,
            rasters: HashMap::new(),
        }
    }

    /// Returns the number of rows of a line; all ink lies within them
    pub(super) fn line_px(&self) -> usize {
        self.ascent_px + self.descent_px
    }

    /// Returns the size of the em square, in px
    pub(super) fn size_px(&self) -> f64 {
        f64::from(self.size_px)
    }

    /// Returns the first row of capital letters and digits in a line, and their number of rows
    pub(super) fn capitals_px(&self) -> (usize, usize) {
        let height = (self.size_px * CAPITAL_HEIGHT).round() as usize;
        (self.ascent_px.saturating_sub(height), height)
    }

    /// Returns the number of columns from the first with ink to the last; zero for blanks
    pub(super) fn width(&mut self, text: &str) -> usize {
        self.set(text).width
    }

    /// Draws one line of text, with its upper left corner at `(left, top)` and [`Self::width`] columns
    pub(super) fn draw(
        &mut self,
        photo: &mut Photo,
        (left, top): (usize, usize),
        text: &str,
        color: Color,
    ) {
        let line = self.set(text);
        let baseline = (top + self.ascent_px) as i64;
        for (key, pen) in line.glyphs {
            let Some(Some(raster)) = self.rasters.get(&key) else {
                continue;
            };
            let first_column = left as i64 + i64::from(pen + raster.left);
            let first_row = baseline + i64::from(raster.top);
            for row in 0..raster.coverage.height() {
                let y = usize::try_from(first_row + row as i64).ok();
                if let Some(y) = y.filter(|&y| y < photo.height()) {
                    let coverage = raster.coverage.row(row);
                    blend(photo.row_mut(y), first_column, coverage, color);
                }
            }
        }
    }

    /// Returns the text if it is no wider than `width_px`; otherwise its start and end around an ellipsis
    ///
    /// Names that end in a counter or an angle remain distinct. Empty if not even the ellipsis fits.
    pub(super) fn shortened(&mut self, text: &str, width_px: usize) -> String {
        if self.width(text) <= width_px {
            return text.to_owned();
        }
        let characters: Vec<char> = text.chars().collect();
        let keep = |kept: usize| -> String {
            let head = &characters[..kept.div_ceil(2)];
            let tail = &characters[characters.len() - kept / 2..];
            head.iter().chain([&ELLIPSIS]).chain(tail).collect()
        };
        let (mut fits, mut too_many) = (0, characters.len());
        while fits + 1 < too_many {
            let kept = usize::midpoint(fits, too_many);
            if self.width(&keep(kept)) <= width_px {
                fits = kept;
            } else {
                too_many = kept;
            }
        }
        let shortened = keep(fits);
        if self.width(&shortened) <= width_px {
            shortened
        } else {
            String::new()
        }
    }

    /// Positions the glyphs of a line, and rasterizes new ones
    fn set(&mut self, text: &str) -> SetLine {
        let mut glyphs = Vec::with_capacity(text.len());
        let mut ink: Option<(i32, i32)> = None;
        let mut pen = 0f32;
        let mut previous = None;
        for character in text.chars() {
            let glyph = self.glyph_of(character);
            let scaled = self.font.as_scaled(self.scale);
            pen += previous.map_or(0.0, |previous| scaled.kern(previous, glyph));
            let advance = scaled.h_advance(glyph);
            let key = (glyph, ((pen - pen.floor()) * SUBPIXELS) as u8);
            let column = pen.floor() as i32;
            if let Some(raster) = self.raster(key) {
                let left = column + raster.left;
                let right = left + raster.coverage.width() as i32;
                ink = Some(ink.map_or((left, right), |(l, r)| (l.min(left), r.max(right))));
                glyphs.push((key, column));
            }
            pen += advance;
            previous = Some(glyph);
        }
        let (left, right) = ink.unwrap_or_default();
        for (_, column) in &mut glyphs {
            *column -= left;
        }
        SetLine {
            glyphs,
            width: (right - left) as usize,
        }
    }

    fn glyph_of(&self, character: char) -> GlyphId {
        let glyph = self.font.glyph_id(character);
        if glyph == GlyphId(0) || character.is_control() {
            self.font.glyph_id(REPLACEMENT)
        } else {
            glyph
        }
    }

    /// Returns the raster of a glyph; `None` for glyphs without ink
    fn raster(&mut self, key: RasterKey) -> Option<&Raster> {
        let (font, scale) = (&self.font, self.scale);
        let rows = -(self.ascent_px as i32)..self.descent_px as i32;
        let raster = self.rasters.entry(key);
        raster
            .or_insert_with(|| rasterize(font, scale, rows, key))
            .as_ref()
    }
}

/// Rasterizes a glyph in the rows of a line, relative to the baseline
fn rasterize(
    font: &FontRef,
    scale: PxScale,
    rows: Range<i32>,
    (glyph, offset): RasterKey,
) -> Option<Raster> {
    let position = point(f32::from(offset) / SUBPIXELS, 0.0);
    let outline = font.outline_glyph(glyph.with_scale_and_position(scale, position))?;
    let bounds = outline.px_bounds();
    let mut coverage = Grid::filled(bounds.width() as usize, bounds.height() as usize, 0u8);
    let (width, height) = (coverage.width(), coverage.height());
    outline.draw(|x, y, covered| {
        let in_line = rows.contains(&(bounds.min.y as i32 + y as i32));
        let (x, y) = (x as usize, y as usize);
        if in_line && x < width && y < height {
            coverage[(x, y)] = (covered.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        }
    });
    let (x0, y0, x1, y1) = coverage.bounding_box_where(|&covered| covered > 0)?;
    Some(Raster {
        left: bounds.min.x as i32 + x0 as i32,
        top: bounds.min.y as i32 + y0 as i32,
        coverage: coverage.crop(x0, y0, x1 - x0, y1 - y0),
    })
}

/// Blends a row of coverage into a row of pixels, clipped to it
fn blend(pixels: &mut [Color], first: i64, coverage: &[u8], color: Color) {
    for (x, &covered) in (first..).zip(coverage) {
        if let Ok(x) = usize::try_from(x)
            && let Some(pixel) = pixels.get_mut(x)
        {
            mix(pixel, color, f64::from(covered) / 255.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the columns and rows of the ink of a text drawn at (20, 20): the first ones and those after the last
    fn drawn(lettering: &mut Lettering, text: &str) -> Option<(usize, usize, usize, usize)> {
        let size = (lettering.width(text) + 40, lettering.line_px() + 40);
        let mut photo = Photo::filled(size.0, size.1, [0; 3]);
        lettering.draw(&mut photo, (20, 20), text, [255; 3]);
        photo.bounding_box_where(|&pixel| pixel != [0; 3])
    }

    #[test]
    fn letters_have_ink_and_blanks_have_none() {
        let mut lettering = Lettering::new(16.0);
        for text in ["A", "ä", "°", "–", "²", "…", "Ж", "ω"] {
            assert!(drawn(&mut lettering, text).is_some(), "{text}");
            assert!(!lettering.shortened(text, 100).contains(REPLACEMENT));
        }
        assert_eq!((lettering.width(""), lettering.width("  ")), (0, 0));
        assert!(lettering.width("mm") > 2 * lettering.width("i"));
        assert!(lettering.width("a b") > lettering.width("ab"));
    }

    #[test]
    fn unknown_characters_and_controls_are_visible() {
        let mut lettering = Lettering::new(16.0);
        let replacement = drawn(&mut lettering, "\u{fffd}");
        assert!(replacement.is_some());
        for text in ["漢", "\u{1f9cd}", "\n", "\0"] {
            assert_eq!(drawn(&mut lettering, text), replacement, "{text:?}");
        }
    }

    #[test]
    fn combining_marks_take_no_columns() {
        let mut lettering = Lettering::new(20.0);
        assert_eq!(lettering.width("Mu\u{308}ller"), lettering.width("Muller"));
    }

    #[test]
    fn edges_are_smooth() {
        let mut photo = Photo::filled(60, 60, [0; 3]);
        Lettering::new(40.0).draw(&mut photo, (5, 5), "O", [255; 3]);
        let between = |pixel: &&Color| (1..255).contains(&pixel[0]);
        assert!(photo.as_slice().iter().filter(between).count() > 40);
        assert!(photo.as_slice().contains(&[255; 3]));
    }

    #[test]
    fn long_names_keep_both_ends() {
        let mut lettering = Lettering::new(16.0);
        let name = "a_long_folder_name_Müller_045";
        let short = lettering.shortened(name, 100);
        assert!(short.starts_with("a_") && short.ends_with("045"), "{short}");
        assert_eq!(lettering.shortened("short", 100), "short");
        assert_eq!(lettering.shortened(name, 2), "");
    }

    #[test]
    fn any_size_of_text_is_accepted() {
        for size in [f64::NAN, -1.0, 0.0, f64::INFINITY] {
            assert!(Lettering::new(size).line_px() > 3);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

        #[test]
        fn the_measured_box_is_drawn(text in "\\PC{0,24}", size in 6.0..50.0f64) {
            let mut lettering = Lettering::new(size);
            let width = lettering.width(&text);
            match drawn(&mut lettering, &text) {
                Some((left, top, right, bottom)) => {
                    prop_assert_eq!((left, right), (20, 20 + width));
                    prop_assert!(top >= 20 && bottom <= 20 + lettering.line_px());
                }
                None => prop_assert_eq!(width, 0),
            }
        }

        #[test]
        fn shortened_text_fits(text in "\\PC{0,60}", size in 6.0..50.0f64, room in 0..400usize) {
            let mut lettering = Lettering::new(size);
            let shortened = lettering.shortened(&text, room);
            prop_assert!(lettering.width(&shortened) <= room);
        }
    }
}
