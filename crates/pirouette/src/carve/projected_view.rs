//! Views prepared for lookups during carving.

use glam::DVec3;

use super::CarveView;
use pirouette_body::lens::Lens;
use pirouette_geom::outline_map::OutlineMap;

/// A silhouette's outline map and the projection onto it
pub(super) struct ProjectedView<'a> {
    map: &'a OutlineMap,
    /// View frame (x right, y down, z forward, mm) of the world origin
    origin: DVec3,
    /// View frame of the world's axes
    axes: [DVec3; 3],
    focal_px: f64,
    pub(super) mm_per_px_at_unit_depth: f64,
    /// Principal point, px
    center: [f64; 2],
    lens: Lens,
}

impl<'a> ProjectedView<'a> {
    pub(super) fn new(view: &CarveView<'a>) -> Self {
        let room_from_world = view.turn.room_from_world();
        let origin = view.camera.view_from_room(DVec3::ZERO);
        Self {
            map: view.outline,
            origin,
            axes: DVec3::AXES
                .map(|axis| view.camera.view_from_room(room_from_world * axis) - origin),
            focal_px: view.camera.focal_px(),
            mm_per_px_at_unit_depth: view.camera.focal_px().recip(),
            center: [
                view.camera.width_px as f64 / 2.0,
                view.camera.height_px as f64 / 2.0,
            ],
            lens: view.camera.lens(),
        }
    }

    /// Returns the depth of a world point along the optical axis, in mm
    pub(super) fn depth(&self, point: DVec3) -> f64 {
        self.origin.z + DVec3::from_array(self.axes.map(|axis| axis.z)).dot(point)
    }

    /// Returns the projection of a world point, in px, and the size of a pixel there, in mm
    ///
    /// The latter is NaN at and behind the camera, where projection is undefined.
    #[inline]
    fn project(&self, point: DVec3) -> (f64, f64, f64) {
        let [x, y, z] = self.axes;
        let in_view = self.origin + x * point.x + y * point.y + z * point.z;
        let bent = self
            .lens
            .bend(in_view.truncate() * (self.focal_px / in_view.z));
        (
            self.center[0] + bent.x,
            self.center[1] + bent.y,
            if in_view.z > 0.0 {
                in_view.z * self.mm_per_px_at_unit_depth
            } else {
                f64::NAN
            },
        )
    }

    /// Returns the signed distance in mm from a projected point to the silhouette's outline; NaN at and behind the
    /// camera
    #[inline]
    fn to_outline(&self, (u, v, mm_per_px): (f64, f64, f64)) -> f64 {
        self.map.at(u, v) * mm_per_px
    }

    /// Returns the same for a world point
    #[inline]
    pub(super) fn distance(&self, point: DVec3) -> f64 {
        self.to_outline(self.project(point))
    }

    /// Returns the same, and the signed distance to the photo's border
    #[inline]
    pub(super) fn distances(&self, point: DVec3) -> (f64, f64) {
        let (u, v, mm_per_px) = self.project(point);
        let to_photo = f64::max(
            (u - self.center[0]).abs() - self.center[0],
            (v - self.center[1]).abs() - self.center[1],
        );
        let to_outline = self.to_outline((u, v, mm_per_px));
        (to_outline, to_photo * mm_per_px)
    }

    /// Raises the values at points to their distances to the silhouette's outline
    ///
    /// Points are projected in batches before the map is sampled.
    #[inline]
    pub(super) fn raise(&self, points: &[DVec3], values: &mut [f64]) {
        const RUN: usize = 32;
        for (points, values) in points.chunks(RUN).zip(values.chunks_mut(RUN)) {
            let mut places = [(0.0, 0.0, 0.0); RUN];
            for (place, &point) in places.iter_mut().zip(points) {
                *place = self.project(point);
            }
            for (value, &place) in values.iter_mut().zip(&places) {
                *value = nan_max(self.to_outline(place), *value);
            }
        }
    }
}

/// A subset of the views, by index
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ViewSet(u128);

impl ViewSet {
    /// Views beyond this number are not distinguished
    pub(super) const MOST: usize = u128::BITS as usize;

    pub(super) const ALL: Self = Self(u128::MAX);

    /// Returns the indices in the set, in ascending order; those of views that do not exist come last
    pub(super) fn indices(self) -> impl Iterator<Item = usize> {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let index = (left != 0).then(|| left.trailing_zeros() as usize)?;
            left &= left - 1;
            Some(index)
        })
    }

    /// Selects the views that are in the set
    ///
    /// Views beyond the capacity of the set are not distinguished: they belong to all sets.
    #[inline]
    pub(super) fn of<T>(self, views: &[T]) -> impl Iterator<Item = &T> {
        let some = self.indices().map_while(|index| views.get(index));
        some.chain(views.get(Self::MOST..).into_iter().flatten())
    }

    pub(super) fn only(self, keep: impl Fn(usize) -> bool) -> Self {
        Self(
            self.indices()
                .filter(|&index| keep(index))
                .fold(0, |set, index| set | 1 << index),
        )
    }
}

/// Returns the larger number; NaN if one is, unlike `f64::max`
pub(super) fn nan_max(a: f64, b: f64) -> f64 {
    if a >= b || a.is_nan() { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_contain_only_existing_views() {
        let views: Vec<usize> = (0..130).collect();
        let all = |count: usize| ViewSet::ALL.of(&views[..count]).copied();
        for count in [0, 1, 5, 127, 128, 130] {
            assert!(all(count).eq(0..count), "{count}");
        }
        let odd = ViewSet::ALL.only(|index| index % 2 == 1);
        assert!(odd.of(&views[..6]).eq(&[1, 3, 5]));
        assert!(odd.only(|index| index > 3).of(&views[..6]).eq(&[5]));
    }
}
