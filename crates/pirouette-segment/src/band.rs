//! The cut through the undecided band of one photo.

use std::ops::Range;

use pirouette_geom::{Grid, Mask};

use crate::links::{Contrast, LinkRows, RowLinks};
use crate::max_flow::{DIRECTIONS, GridCut};
use crate::seeds::{Seed, Window};

/// Capacity of one unit of energy; whole numbers make the cut exact
const CAPACITY_SCALE: f32 = 256.0;

/// Energies beyond this are as good as certain, and capacities stay far from overflow
const MAX_ENERGY: f32 = 50_000.0;

/// The undecided pixels of one photo, linked by how much neighbors look alike
///
/// Everything works on the box of the undecided pixels. The links are made once; every
/// [`BandCut::solve`] continues from the flow of the last one.
#[derive(Debug)]
pub struct BandCut {
    window: Option<Window>,
    /// Undecided pixels in photo coordinates, in the order of the nodes
    pixels: Vec<(u32, u32)>,
    cut: GridCut,
    /// Data terms of the last cut, in capacity
    terminals: Vec<i32>,
}

impl BandCut {
    /// Links the undecided pixels of a photo
    ///
    /// Neighbors `p`, `q` cost `smoothness / dist(p, q) * exp(-beta |I_p - I_q|^2)` when they are parted. With a
    /// plate, contrast that the background shows too counts less.
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
        link(
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

    /// Column and row of every undecided pixel, row by row
    pub fn pixels(&self) -> &[(u32, u32)] {
        &self.pixels
    }

    /// Labels the undecided pixels by the cheapest cut
    ///
    /// `log_odds`: how much likelier each of [`BandCut::pixels`] is person than background, natural logarithm; what
    /// is not a number counts as even.
    ///
    /// # Panics
    /// When there is not one value per undecided pixel.
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

    /// The seeds with every undecided pixel decided by the last cut
    pub fn mask(&self, seeds: &Grid<Seed>) -> Mask {
        let mut mask = seeds.map(|seed| *seed == Seed::Person);
        for (node, &(x, y)) in self.pixels.iter().enumerate() {
            mask[(x as usize, y as usize)] = self.cut.on_source_side(node);
        }
        mask
    }

    /// Whether there is anything to decide
    pub fn undecided(&self) -> bool {
        self.window.is_some()
    }
}

/// Stretches of two rows that hold all undecided pixels and those beside them; short gaps are not worth a new one
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
    // a cast cuts off, and takes NaN to zero
    let scaled = energy.clamp(-MAX_ENERGY, MAX_ENERGY) * CAPACITY_SCALE;
    (scaled + 0.5_f32.copysign(scaled)) as i32
}

/// Gives every node its links: to undecided neighbors by themselves, to decided ones as terminal capacity
fn link(cut: &mut GridCut, seeds: &Grid<Seed>, window: Window, mut rows: LinkRows) {
    let mut above = RowLinks::new(window.width);
    let mut current = above.clone();
    let mut columns = Vec::new();
    let mut node = 0;
    for y in 0..window.height {
        let row = window.row(seeds, y);
        let below = (y + 1 < window.height).then(|| window.row(seeds, y + 1));
        linked_columns(row, below.unwrap_or(row), &mut columns);
        rows.read(&columns, &mut current);
        for (x, _) in row.iter().enumerate().filter(|(_, seed)| seed.undecided()) {
            // links begin at the first pixel of a pair; rows of links begin one before the pixels
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
    use crate::links::contrast_scale;
    use crate::plate::BackgroundPlate;

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
            plate: None,
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
    fn nothing_undecided_leaves_the_seeds() {
        let photo = Grid::filled(3, 1, [5; 3]);
        let seeds = seeds(".#.");
        let mut band = BandCut::new(&photo, &seeds, contrast(&photo, &seeds, 50.0));
        band.solve(&[]);
        assert!(!band.undecided());
        assert_eq!(band.mask(&seeds), Mask::from_art(".#."));
    }

    #[test]
    fn strong_odds_win_over_smoothness_and_nan_is_even() {
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
    fn an_edge_of_the_plate_does_not_attract_the_cut() {
        // the wall changes its color at column 4, the person's coat is a little darker up to column 2
        let wall = |x: usize| if x < 4 { [200_u8; 3] } else { [90; 3] };
        let photo = Grid::from_fn(8, 4, |x, _| if x < 3 { [170; 3] } else { wall(x) });
        let empty = Grid::from_fn(8, 4, |x, _| wall(x));
        let all = Mask::filled(8, 4, true);
        let plate = BackgroundPlate::estimate(&[(&empty, &all)], &Default::default()).unwrap();
        let seeds = seeds("#------. #------. #------. #------.");
        let area = |plate| {
            let mut band = BandCut::new(
                &photo,
                &seeds,
                Contrast {
                    plate,
                    ..contrast(&photo, &seeds, 50.0)
                },
            );
            band.solve(&[0.0; 24]);
            band.mask(&seeds).area()
        };
        assert_eq!(area(None), 16);
        assert_eq!(area(Some(&plate)), 12);
    }
}
