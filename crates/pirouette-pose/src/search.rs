//! Search for a person in a complete photo, without a separate detection network
//!
//! The network reports the presence of a person in its region, and the person's region. Windows of decreasing size are
//! therefore tried until the presence is certain. On photos of persons of 30 to 95 % of the photo's height this finds
//! everyone whom a detection network finds.
//!
//! The network sees persons in patterns, too, up to a presence of 0.998, but not in their mirror images. A person is
//! therefore reported only if the network finds the same one in the mirror: in 111 photos without a person (noise, and strips
//! from the borders of photos of streets), one is found in 18 without this test, and in none with it. Photos of persons have at
//! least 0.997 in both, and landmarks that differ by at most 0.016 of the region's size (127 photos).

use crate::model::Runner;
use crate::{Detection, Photo, PoseModel, Region};

/// Sizes of windows relative to the longer side of the photo
const WINDOW_SIZES: [f64; 4] = [1.0, 0.75, 0.55, 0.4];
/// Largest distance of windows relative to their size
const WINDOW_STEP: f64 = 0.3;
/// Presence above which smaller windows are not tried
const CERTAIN_PRESENCE: f64 = 0.98;
/// Presence in the first pass below which a window is dropped
const MIN_FIRST_PRESENCE: f64 = 0.5;
/// Presence below which no person is reported, in the photo and in its mirror image
const MIN_PRESENCE: f64 = 0.95;
/// Median distance of the landmarks of trunk and limbs from those in the mirror above which there is no person, relative to
/// the region's size
const MAX_MIRRORED_DISTANCE: f64 = 0.03;
/// Indices of left and right shoulder, elbow, hip, knee and ankle
const SIDES: [[usize; 2]; 5] = [[11, 12], [13, 14], [23, 24], [25, 26], [27, 28]];
/// Passes per window; each follows the region of the one before
const PASSES: usize = 3;

impl PoseModel {
    /// Searches the complete photo for a person and returns the person's region, `None` if none is found.
    ///
    /// Takes three passes if the person fills the photo, up to about 70 if there is none. If several persons are
    /// visible, the one that the network is most certain of is returned.
    pub fn search(&self, photo: &Photo) -> Option<Region> {
        self.search_where(photo, &|_| true)
    }

    /// Searches the complete photo for another person than the one in `region`; otherwise as [`Self::search`].
    pub fn search_beside(&self, photo: &Photo, region: &Region) -> Option<Region> {
        self.search_where(photo, &|found| found.next_region.is_elsewhere(region))
    }

    fn search_where(&self, photo: &Photo, accepted: &dyn Fn(&Detection) -> bool) -> Option<Region> {
        let mut runner = Runner::new(self, *photo, false);
        let mut best: Option<Detection> = None;
        let is_better = |found: &Detection, best: &Option<Detection>| {
            best.as_ref()
                .is_none_or(|best| found.presence > best.presence)
        };
        for size in WINDOW_SIZES {
            for window in windows(runner.photo(), size) {
                let found = follow(&mut runner, window);
                if is_better(&found, &best) && accepted(&found) {
                    best = Some(found);
                }
            }
            if let Some(found) = best.take_if(|best| best.presence > CERTAIN_PRESENCE)
                && is_in_mirror(&mut runner, &found.next_region)
            {
                return Some(found.next_region);
            }
        }
        best.filter(|best| best.presence > MIN_PRESENCE)
            .map(|best| best.next_region)
            .filter(|region| is_in_mirror(&mut runner, region))
    }
}

/// Returns whether the person in a region is found in its mirror image, too
fn is_in_mirror(runner: &mut Runner, region: &Region) -> bool {
    let seen = runner.run(region);
    let mirrored = runner.run(&region.mirror_image());
    let distance = |[a, b]: [usize; 2]| {
        let [p, q] = [seen.landmarks[a].position, mirrored.landmarks[b].position];
        (p[0] - q[0]).hypot(p[1] - q[1]) / region.size()
    };
    let both = SIDES.into_iter().flat_map(|[a, b]| [[a, b], [b, a]]);
    let mut distances: Vec<f64> = both.map(distance).collect();
    distances.sort_by(f64::total_cmp);
    let presence = seen.presence.min(mirrored.presence);
    presence > MIN_PRESENCE && distances[distances.len() / 2] < MAX_MIRRORED_DISTANCE
}

/// Runs passes that start with a window.
fn follow(runner: &mut Runner, window: Region) -> Detection {
    let mut found = runner.run(&window);
    if found.presence < MIN_FIRST_PRESENCE {
        return found;
    }
    for _ in 1..PASSES {
        found = runner.run(&found.next_region);
    }
    found
}

/// Returns windows that cover the photo, those at its center first.
fn windows(photo: &Photo, relative_size: f64) -> Vec<Region> {
    let (width, height) = (photo.width() as f64, photo.height() as f64);
    let size = width.max(height) * relative_size;
    let columns = centers(width, size);
    let at = |y: f64| {
        columns
            .iter()
            .filter_map(move |&x| Region::upright([x, y], size))
    };
    centers(height, size).into_iter().flat_map(at).collect()
}

/// Returns the centers of windows of `size` px along a side of the photo, the middle first.
fn centers(side: f64, size: f64) -> Vec<f64> {
    if size >= side {
        return vec![side / 2.0];
    }
    let count = ((side - size) / (WINDOW_STEP * size)).ceil();
    let mut centers: Vec<f64> = (0..=count as usize)
        .map(|i| size / 2.0 + (side - size) * i as f64 / count)
        .collect();
    centers.sort_by(|a, b| (a - side / 2.0).abs().total_cmp(&(b - side / 2.0).abs()));
    centers
}

#[cfg(test)]
mod tests {
    use super::{WINDOW_SIZES, centers, windows};
    use crate::Photo;

    #[test]
    fn windows_cover_the_photo_and_start_at_its_center() {
        let found = centers(100.0, 40.0);
        assert_eq!(found.len(), 6);
        assert!((found[0] - 50.0).abs() < 7.0);
        assert!(found.contains(&20.0) && found.contains(&80.0));
        assert_eq!(centers(30.0, 40.0), [15.0]);
    }

    #[test]
    fn a_photo_has_at_most_a_few_dozen_windows() {
        let pixels = vec![[0; 3]; 90_000];
        let photo = Photo::new(300, 300, &pixels).unwrap();
        let count: usize = WINDOW_SIZES
            .iter()
            .map(|&size| windows(&photo, size).len())
            .sum();
        assert_eq!(count, 1 + 9 + 16 + 36);
    }
}
