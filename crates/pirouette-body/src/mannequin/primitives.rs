//! Building blocks of the body: tubes along curves, with egg-shaped sections, ellipsoids and cones.

use glam::{DMat3, DVec2, DVec3};

/// A cross-section of a tube: half-ellipses of different radii in each direction, optionally squared off
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Section {
    /// Shift of the section's center from the tube's axis, to the side and to the front
    pub center: DVec2,
    /// Radius to the side away from the body's middle
    pub outer: f64,
    /// Radius to the other side
    pub inner: f64,
    /// Radius to the front
    pub front: f64,
    /// Radius to the back
    pub back: f64,
    /// Squareness of the front half: 0 elliptic, 1 a superellipse of exponent 4
    pub square_front: f64,
    /// Squareness of the back half
    pub square_back: f64,
}

impl Section {
    fn channels(&self) -> [f64; 8] {
        [
            self.center.x,
            self.center.y,
            self.outer,
            self.inner,
            self.front,
            self.back,
            self.square_front,
            self.square_back,
        ]
    }

    fn from_channels(c: [f64; 8]) -> Self {
        Self {
            center: DVec2::new(c[0], c[1]),
            outer: c[2],
            inner: c[3],
            front: c[4],
            back: c[5],
            square_front: c[6],
            square_back: c[7],
        }
    }

    fn lerp(&self, other: &Self, t: f64) -> Self {
        let (a, b) = (self.channels(), other.channels());
        Self::from_channels(std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t))
    }

    /// Returns the distance of a point of the section's plane from the section's center, and its multiple of the radius
    /// there
    fn polar(&self, p: DVec2) -> (f64, f64) {
        let q = p - self.center;
        let u = q.x / if q.x >= 0.0 { self.outer } else { self.inner };
        let (depth, square) = if q.y >= 0.0 {
            (self.front, self.square_front)
        } else {
            (self.back, self.square_back)
        };
        let w = q.y / depth;
        let (u2, w2) = (u * u, w * w);
        let round = (u2 + w2).sqrt();
        let ratio = if square.abs() < 1e-6 {
            round
        } else {
            let squared = (u2 * u2 + w2 * w2).sqrt().sqrt();
            round + (squared - round) * square
        };
        (q.length(), ratio)
    }

    fn smallest_radius(&self) -> f64 {
        self.outer.min(self.inner).min(self.front).min(self.back)
    }

    fn reach(&self) -> f64 {
        self.center.length() + self.outer.max(self.inner).max(self.front).max(self.back)
    }
}

/// A tube of varying sections along a straight axis, closed by half-ellipsoids
#[derive(Debug, Clone)]
pub(super) struct Tube {
    origin: DVec3,
    /// Columns: to the side, along, to the front
    axes: DMat3,
    start: f64,
    end: f64,
    step: f64,
    sections: Vec<Section>,
    /// Length of the half-ellipsoids beyond start and end
    caps: [f64; 2],
}

/// Spacing of the tabulated sections of a tube, in mm
///
/// Linear interpolation over it stays within 0.1 mm of the curves.
const SECTION_STEP: f64 = 4.0;

impl Tube {
    /// Fits a smooth curve through sections given at increasing stations along the axis
    ///
    /// # Panics
    /// With fewer than two keys.
    pub(super) fn new(origin: DVec3, axes: DMat3, keys: &[(f64, Section)], caps: [f64; 2]) -> Self {
        let stations: Vec<f64> = keys.iter().map(|(t, _)| *t).collect();
        let channels: Vec<[f64; 8]> = keys.iter().map(|(_, s)| s.channels()).collect();
        let curves: [Curve; 8] = std::array::from_fn(|c| {
            Curve::new(
                stations
                    .iter()
                    .zip(&channels)
                    .map(|(&t, values)| (t, values[c]))
                    .collect(),
            )
        });
        let (start, end) = (stations[0], stations[stations.len() - 1]);
        let count = ((end - start) / SECTION_STEP).ceil().max(1.0);
        let step = (end - start) / count;
        let sections: Vec<Section> = (0..=count as usize)
            .map(|i| {
                let t = start + step * i as f64;
                Section::from_channels(std::array::from_fn(|c| curves[c].at(t)))
            })
            .collect();
        Self {
            origin,
            axes,
            start,
            end,
            step,
            sections,
            caps,
        }
    }

    /// Smooths abrupt bends of the curves over about `width` mm along the axis; the end sections are unchanged
    pub(super) fn smoothed(mut self, width: f64) -> Self {
        // Each pass of weights 1/4, 1/2, 1/4 adds half a squared step to the variance.
        let passes = (2.0 * (width / self.step).powi(2)).ceil() as usize;
        let mut values: Vec<[f64; 8]> = self.sections.iter().map(Section::channels).collect();
        for _ in 0..passes {
            let mut before = values[0];
            for i in 1..values.len().saturating_sub(1) {
                let own = values[i];
                let after = values[i + 1];
                values[i] =
                    std::array::from_fn(|c| 0.25 * before[c] + 0.5 * own[c] + 0.25 * after[c]);
                before = own;
            }
        }
        self.sections = values.into_iter().map(Section::from_channels).collect();
        self
    }

    /// Returns the section at a station along the axis
    pub(super) fn section(&self, station: f64) -> Section {
        let x = ((station.clamp(self.start, self.end) - self.start) / self.step).max(0.0);
        let last = self.sections.len() - 1;
        let i = (x as usize).min(last.saturating_sub(1));
        self.sections[i].lerp(&self.sections[(i + 1).min(last)], x - i as f64)
    }

    /// Returns the coordinates of a point along side, axis and front
    pub(super) fn local(&self, p: DVec3) -> DVec3 {
        self.axes.transpose() * (p - self.origin)
    }

    /// Returns the point at these coordinates along side, axis and front
    pub(super) fn world(&self, local: DVec3) -> DVec3 {
        self.origin + self.axes * local
    }

    fn distance(&self, p: DVec3) -> f64 {
        let q = self.local(p);
        let section = self.section(q.y);
        let (radial, ratio) = section.polar(DVec2::new(q.x, q.z));
        let (beyond, cap) = if q.y > self.end {
            (q.y - self.end, self.caps[1])
        } else if q.y < self.start {
            (self.start - q.y, self.caps[0])
        } else {
            (0.0, 1.0)
        };
        let (length, ratio) = if beyond > 0.0 {
            (radial.hypot(beyond), ratio.hypot(beyond / cap.max(1e-3)))
        } else {
            (radial, ratio)
        };
        if ratio < 1e-3 {
            return -section.smallest_radius();
        }
        length - length / ratio
    }

    fn bounds(&self) -> (DVec3, DVec3) {
        let reach = self.sections.iter().map(Section::reach).fold(0.0, f64::max);
        let ends = [self.start - self.caps[0], self.end + self.caps[1]]
            .map(|t| self.world(DVec3::new(0.0, t, 0.0)));
        // A disk perpendicular to a unit axis reaches sqrt(1 - axis^2) of its radius along each coordinate.
        let axis = self.axes.y_axis;
        let disk = (DVec3::ONE - axis * axis).max(DVec3::ZERO).map(f64::sqrt) * reach;
        (ends[0].min(ends[1]) - disk, ends[0].max(ends[1]) + disk)
    }
}

/// A smooth curve through given points that does not overshoot them
///
/// # Source
/// Fritsch and Butland 1984, "A method for constructing local monotone piecewise cubic interpolants".
#[derive(Debug, Clone)]
pub(super) struct Curve {
    points: Vec<(f64, f64)>,
    slopes: Vec<f64>,
}

impl Curve {
    /// Interpolates points of increasing abscissa
    pub(super) fn new(points: Vec<(f64, f64)>) -> Self {
        let n = points.len();
        let rise = |i: usize| -> f64 {
            (points[i + 1].1 - points[i].1) / (points[i + 1].0 - points[i].0).max(1e-9)
        };
        let slopes = (0..n)
            .map(|i| {
                if n < 2 || i == 0 || i == n - 1 {
                    return if n < 2 { 0.0 } else { rise(i.min(n - 2)) * 0.8 };
                }
                let (a, b) = (rise(i - 1), rise(i));
                if a * b <= 0.0 {
                    return 0.0;
                }
                let (h0, h1) = (points[i].0 - points[i - 1].0, points[i + 1].0 - points[i].0);
                let alpha = (h0 + 2.0 * h1) / (3.0 * (h0 + h1));
                a * b / (alpha * b + (1.0 - alpha) * a)
            })
            .collect();
        Self { points, slopes }
    }

    /// Returns the value at an abscissa; constant beyond the ends
    pub(super) fn at(&self, x: f64) -> f64 {
        let after = self.points.partition_point(|(px, _)| *px <= x);
        if after == 0 {
            return self.points[0].1;
        }
        if after == self.points.len() {
            return self.points[after - 1].1;
        }
        let ((x0, y0), (x1, y1)) = (self.points[after - 1], self.points[after]);
        let h = x1 - x0;
        let t = (x - x0) / h;
        let (m0, m1) = (self.slopes[after - 1] * h, self.slopes[after] * h);
        let (t2, t3) = (t * t, t * t * t);
        y0 * (2.0 * t3 - 3.0 * t2 + 1.0)
            + m0 * (t3 - 2.0 * t2 + t)
            + y1 * (3.0 * t2 - 2.0 * t3)
            + m1 * (t3 - t2)
    }
}

/// One building block of the body
#[derive(Debug, Clone)]
pub(super) enum Shape {
    /// A tube of varying sections
    Tube(Tube),
    /// An ellipsoid with radii along the columns of `axes`
    Ellipsoid {
        center: DVec3,
        axes: DMat3,
        radii: DVec3,
    },
    /// The convex hull of two balls
    Cone {
        from: DVec3,
        to: DVec3,
        radii: [f64; 2],
    },
}

impl Shape {
    /// Creates an ellipsoid along the axes of the world
    pub(super) fn ellipsoid(center: DVec3, radii: DVec3) -> Self {
        Shape::Ellipsoid {
            center,
            axes: DMat3::IDENTITY,
            radii,
        }
    }

    pub(super) fn distance(&self, p: DVec3) -> f64 {
        match self {
            Shape::Tube(tube) => tube.distance(p),
            Shape::Ellipsoid {
                center,
                axes,
                radii,
            } => {
                let q = axes.transpose() * (p - *center) / *radii;
                let ratio = q.length();
                let gradient = (q / *radii).length();
                if gradient < 1e-9 {
                    return -radii.min_element();
                }
                ratio * (ratio - 1.0) / gradient
            }
            Shape::Cone { from, to, radii } => {
                let axis = *to - *from;
                let t = ((p - *from).dot(axis) / axis.length_squared().max(1e-12)).clamp(0.0, 1.0);
                (p - (*from + axis * t)).length() - (radii[0] + (radii[1] - radii[0]) * t)
            }
        }
    }

    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        match self {
            Shape::Tube(tube) => tube.bounds(),
            Shape::Ellipsoid {
                center,
                axes,
                radii,
            } => {
                let scaled = DMat3::from_cols(
                    axes.x_axis * radii.x,
                    axes.y_axis * radii.y,
                    axes.z_axis * radii.z,
                )
                .transpose();
                let reach = DVec3::new(
                    scaled.x_axis.length(),
                    scaled.y_axis.length(),
                    scaled.z_axis.length(),
                );
                (*center - reach, *center + reach)
            }
            Shape::Cone { from, to, radii } => {
                let r = DVec3::splat(radii[0].max(radii[1]));
                (from.min(*to) - r, from.max(*to) + r)
            }
        }
    }
}
