//! Graph cut of the undecided band of one photo.

use std::ops::Range;

use pirouette_geom::{Grid, Mask};

use crate::links::{Contrast, LinkRows, RowLinks};
use crate::max_flow::{DIRECTIONS, GridCut};
use crate::seeds::{Seed, Window};

/// Capacity of one unit of energy; integers make the cut exact
const CAPACITY_SCALE: f32 = 256.0;

/// Larger energies are clamped: they are practically certain, and capacities stay far from overflow
const MAX_ENERGY: f32 = 50_000.0;

/// Graph of the undecided pixels of one photo, with neighbors linked by color similarity
///
/// Works on the bounding box of the undecided pixels. The links are computed once; every [`BandCut::solve`] continues
/// from the flow of the previous one.
#[derive(Debug)]
pub struct BandCut {
    window: Option<Window>,
    /// Undecided pixels in photo coordinates, in node order
    pixels: Vec<(u32, u32)>,
    cut: GridCut,
    /// Data terms of the previous cut, as capacities
    terminals: Vec<i32>,
}

impl BandCut {
    /// Links the undecided pixels of a photo
    ///
    /// Separating neighbors `p`, `q` costs `smoothness / dist(p, q) * exp(-beta |I_p - I_q|^2)`. With a clean plate,
    /// contrast that the background also has is attenuated.
    ///
    /// # Panics
    /// When photo and seeds differ in size.
    ///
    /// # Source
    /// C. Rother, V. Kolmogorov, A. Blake, 2004, GrabCut, equations 4 and 11. Attenuation: J. Sun,
    /// W. Zhang, X. Tang, H. Shum, 2006, Background cut, equation 6.
    pub fn new(photo: &Grid<[u8; 3]>, seeds: &Grid<Seed>, contrast: Contrast) -> Self {
        assert!(photo.same_size(seeds), "one seed per pixel");
        let undecided = seeds.map(|seed| seed.undecided());
        let Some(window) = Window::around(&undecided, 1) else {
            return Self {
                window: None,
                pixels: Vec::new(),
                cut: GridCut::new(&Mask::filled(0, 0, false)),
                terminals: Vec::new(),
            };
        };
        let mut cut = GridCut::new(&window.crop(&undecided));
        let mut pixels = Vec::with_capacity(cut.node_count());
        for y in 0..window.height {
            let row = window.row(&undecided, y).iter().enumerate();
            pixels.extend(
                row.filter(|(_, u)| **u)
                    .map(|(x, _)| ((window.x0 + x) as u32, (window.y0 + y) as u32)),
            );
        }
        set_links(
            &mut cut,
            seeds,
            window,
            LinkRows::new(photo, window, contrast),
        );
        Self {
            window: Some(window),
            terminals: vec![0; pixels.len()],
            pixels,
            cut,
        }
    }

    /// Returns column and row of every undecided pixel, row by row
    pub fn pixels(&self) -> &[(u32, u32)] {
        &self.pixels
    }

    /// Labels the undecided pixels by the minimum cut
    ///
    /// `log_odds`: natural logarithm of the odds of person against background, one per [`BandCut::pixels`] entry; NaN
    /// counts as even odds.
    ///
    /// # Panics
    /// When the number of values differs from that of undecided pixels.
    pub fn solve(&mut self, log_odds: &[f32]) {
        assert_eq!(
            log_odds.len(),
            self.pixels.len(),
            "one value per undecided pixel"
        );
        for (node, (terminal, &odds)) in self.terminals.iter_mut().zip(log_odds).enumerate() {
            let wanted = capacity(odds);
            self.cut.add_terminal(node, wanted - *terminal);
            *terminal = wanted;
        }
        self.cut.solve();
    }

    /// Returns the seeds as a mask, with every undecided pixel decided by the last cut
    pub fn mask(&self, seeds: &Grid<Seed>) -> Mask {
        let mut mask = seeds.map(|seed| *seed == Seed::Person);
        for (node, &(x, y)) in self.pixels.iter().enumerate() {
            mask[(x as usize, y as usize)] = self.cut.on_source_side(node);
        }
        mask
    }

    /// Whether there are undecided pixels
    pub fn undecided(&self) -> bool {
        self.window.is_some()
    }
}

/// Collects ranges of columns with all undecided pixels of two rows and their neighbors; short gaps are included
fn linked_columns(row: &[Seed], below: &[Seed], columns: &mut Vec<Range<usize>>) {
    const GAP: usize = 16;
    columns.clear();
    for (x, (seed, below)) in row.iter().zip(below).enumerate() {
        if !(seed.undecided() || below.undecided()) {
            continue;
        }
        match columns.last_mut() {
            Some(last) if x <= last.end + GAP => last.end = x + 1,
            _ => columns.push(x..x + 1),
        }
    }
    for columns in columns {
        columns.start = columns.start.saturating_sub(1);
        columns.end += 1;
    }
}

fn capacity(energy: f32) -> i32 {
    // a cast truncates, and maps NaN to zero
    let scaled = energy.clamp(-MAX_ENERGY, MAX_ENERGY) * CAPACITY_SCALE;
    (scaled + 0.5_f32.copysign(scaled)) as i32
}

/// Sets the links of every node: to undecided neighbors as edges, to decided ones as terminal capacity
fn set_links(cut: &mut GridCut, seeds: &Grid<Seed>, window: Window, mut rows: LinkRows) {
    let mut above = RowLinks::new(window.width);
    let mut current = above.clone();
    let mut columns = Vec::new();
    let mut node = 0;
    for y in 0..window.height {
        let row = window.row(seeds, y);
        let below = (y + 1 < window.height).then(|| window.row(seeds, y + 1));
        linked_columns(row, below.unwrap_or(row), &mut columns);
        rows.read_links(&columns, &mut current);
        for (x, _) in row.iter().enumerate().filter(|(_, seed)| seed.undecided()) {
            // links start at the first pixel of a pair; rows of links have one entry before the first pixel
            let energies = [
                current.right[x + 1],
                current.right[x],
                current.below[x + 1],
                above.below[x + 1],
                current.below_right[x + 1],
                above.below_right[x],
                current.below_left[x + 1],
                above.below_left[x + 2],
            ];
            let mut links = energies.map(capacity);
            for (direction, (dx, dy)) in DIRECTIONS.into_iter().enumerate() {
                if cut.neighbor(node, direction).is_some() {
                    continue;
                }
                let link = std::mem::take(&mut links[direction]);
                let (x, y) = (window.x0 + x, window.y0 + y);
                match seeds.get(x as isize + dx, y as isize + dy) {
                    Some(Seed::Person) => cut.add_terminal(node, link),
                    Some(Seed::Background) => cut.add_terminal(node, -link),
                    _ => {}
                }
            }
            cut.set_links(node, links);
            node += 1;
        }
        std::mem::swap(&mut above, &mut current);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean_plate::CleanPlate;
    use crate::links::contrast_scale;

    fn seeds(art: &str) -> Grid<Seed> {
        let rows: Vec<&str> = art.split_whitespace().collect();
        Grid::from_fn(rows[0].len(), rows.len(), |x, y| {
            match rows[y].as_bytes()[x] {
                b'#' => Seed::Person,
                b'+' => Seed::ProbablePerson,
                b'-' => Seed::ProbableBackground,
                _ => Seed::Background,
            }
        })
    }

    fn contrast(photo: &Grid<[u8; 3]>, seeds: &Grid<Seed>, smoothness: f32) -> Contrast<'static> {
        Contrast {
            smoothness,
            beta: contrast_scale(photo, seeds),
            clean_plate: None,
        }
    }

    #[test]
    fn without_colors_the_cut_follows_the_contrast() {
        let photo = Grid::from_fn(8, 3, |x, _| if x < 3 { [200; 3] } else { [20; 3] });
        let seeds = seeds("#------. #------. #------.");
        let mut band = BandCut::new(&photo, &seeds, contrast(&photo, &seeds, 50.0));
        band.solve(&[0.0; 18]);
        assert_eq!(
            band.mask(&seeds),
            Mask::from_art("###..... ###..... ###.....")
        );
    }

    #[test]
    fn without_undecided_pixels_the_mask_equals_the_seeds() {
        let photo = Grid::filled(3, 1, [5; 3]);
        let seeds = seeds(".#.");
        let mut band = BandCut::new(&photo, &seeds, contrast(&photo, &seeds, 50.0));
        band.solve(&[]);
        assert!(!band.undecided());
        assert_eq!(band.mask(&seeds), Mask::from_art(".#."));
    }

    #[test]
    fn strong_odds_override_smoothness_and_nan_is_even() {
        let photo = Grid::filled(5, 1, [5; 3]);
        let seeds = seeds("#---.");
        let mut band = BandCut::new(&photo, &seeds, contrast(&photo, &seeds, 1.0));
        band.solve(&[-9.0, f32::NAN, 9.0]);
        let mask = band.mask(&seeds);
        assert!(mask[(0, 0)] && !mask[(1, 0)] && mask[(3, 0)] && !mask[(4, 0)]);
        band.solve(&[9.0, 9.0, -9.0]);
        assert_eq!(band.mask(&seeds), Mask::from_art("###.."));
    }

    #[test]
    fn an_edge_of_the_clean_plate_does_not_attract_the_cut() {
        // the wall changes color at column 4, the person's coat is a little darker up to column 2
        let wall = |x: usize| if x < 4 { [200_u8; 3] } else { [90; 3] };
        let photo = Grid::from_fn(8, 4, |x, _| if x < 3 { [170; 3] } else { wall(x) });
        let empty = Grid::from_fn(8, 4, |x, _| wall(x));
        let all = Mask::filled(8, 4, true);
        let clean_plate = CleanPlate::estimate(&[(&empty, &all)], &Default::default()).unwrap();
        let seeds = seeds("#------. #------. #------. #------.");
        let area = |clean_plate| {
            let mut band = BandCut::new(
                &photo,
                &seeds,
                Contrast {
                    clean_plate,
                    ..contrast(&photo, &seeds, 50.0)
                },
            );
            band.solve(&[0.0; 24]);
            band.mask(&seeds).area()
        };
        assert_eq!(area(None), 16);
        assert_eq!(area(Some(&clean_plate)), 12);
    }
}
