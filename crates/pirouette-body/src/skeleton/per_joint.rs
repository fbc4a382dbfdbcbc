//! One value per joint or per bone, indexed by [`Joint`] or [`Bone`] instead of by numbers.

use std::ops::{Index, IndexMut};

use super::{Bone, Joint};

/// Defines an array with one value per variant of `$Key`
macro_rules! one_value_per {
    ($(#[$docs:meta])* $Name:ident, $Key:ident) => {
        $(#[$docs])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
        pub struct $Name<T>([T; $Key::COUNT]);

        impl<T> $Name<T> {
            #[doc = concat!("Wraps values in the order of [`", stringify!($Key), "::ALL`]")]
            pub const fn new(values: [T; $Key::COUNT]) -> Self {
                Self(values)
            }

            /// The same value everywhere
            pub const fn splat(value: T) -> Self
            where
                T: Copy,
            {
                Self([value; $Key::COUNT])
            }

            #[doc = concat!("Calls `value` for each [`", stringify!($Key), "`], in order")]
            pub fn from_fn(value: impl FnMut($Key) -> T) -> Self {
                Self($Key::ALL.map(value))
            }

            #[doc = concat!("The values in the order of [`", stringify!($Key), "::ALL`]")]
            pub fn iter(&self) -> std::slice::Iter<'_, T> {
                self.0.iter()
            }

            /// The values in order, for changes
            pub fn iter_mut(&mut self) -> std::slice::IterMut<'_, T> {
                self.0.iter_mut()
            }

            #[doc = concat!("Each [`", stringify!($Key), "`] with its value, in order")]
            pub fn pairs(&self) -> impl Iterator<Item = ($Key, &T)> {
                $Key::ALL.into_iter().zip(&self.0)
            }

            #[doc = concat!("Each [`", stringify!($Key), "`] with its value, in order, for changes")]
            pub fn pairs_mut(&mut self) -> impl Iterator<Item = ($Key, &mut T)> {
                $Key::ALL.into_iter().zip(&mut self.0)
            }

            /// Applies `change` to each value, in order
            pub fn map<U>(self, change: impl FnMut(T) -> U) -> $Name<U> {
                $Name(self.0.map(change))
            }

            #[doc = concat!("Exchanges the values of two [`", stringify!($Key), "`]s")]
            pub fn swap(&mut self, a: $Key, b: $Key) {
                self.0.swap(a as usize, b as usize);
            }

            /// The values as a slice, for code that knows only their order
            pub fn as_slice(&self) -> &[T] {
                &self.0
            }

            /// The values as an array, for code that knows only their order
            pub fn into_array(self) -> [T; $Key::COUNT] {
                self.0
            }
        }

        impl<T> Index<$Key> for $Name<T> {
            type Output = T;

            #[inline]
            fn index(&self, key: $Key) -> &T {
                &self.0[key as usize]
            }
        }

        impl<T> IndexMut<$Key> for $Name<T> {
            #[inline]
            fn index_mut(&mut self, key: $Key) -> &mut T {
                &mut self.0[key as usize]
            }
        }

        impl<T> IntoIterator for $Name<T> {
            type Item = T;
            type IntoIter = std::array::IntoIter<T, { $Key::COUNT }>;

            fn into_iter(self) -> Self::IntoIter {
                self.0.into_iter()
            }
        }

        impl<'a, T> IntoIterator for &'a $Name<T> {
            type Item = &'a T;
            type IntoIter = std::slice::Iter<'a, T>;

            fn into_iter(self) -> Self::IntoIter {
                self.0.iter()
            }
        }

        impl<'a, T> IntoIterator for &'a mut $Name<T> {
            type Item = &'a mut T;
            type IntoIter = std::slice::IterMut<'a, T>;

            fn into_iter(self) -> Self::IntoIter {
                self.0.iter_mut()
            }
        }
    };
}

one_value_per! {
    /// One value per joint
    ///
    /// ```
    /// use pirouette_body::{Joint, PerJoint};
    ///
    /// let mut heights_mm = PerJoint::splat(0.0);
    /// heights_mm[Joint::LeftKnee] = 480.0;
    /// let heights_m = heights_mm.map(|mm| mm / 1000.0);
    /// assert_eq!(heights_m[Joint::LeftKnee], 0.48);
    /// ```
    PerJoint, Joint
}

one_value_per! {
    /// One value per bone; parents come before their children
    ///
    /// ```
    /// use pirouette_body::{Bone, PerBone};
    ///
    /// let depths = PerBone::from_fn(|bone| std::iter::successors(bone.parent(), |b| b.parent()).count());
    /// assert_eq!(depths[Bone::Root], 0);
    /// assert_eq!(depths[Bone::LeftFoot], 3);
    /// ```
    PerBone, Bone
}

impl<T: Copy> PerJoint<T> {
    /// Sets neck and mid hip to the midpoints of their left and right joints, see [`Joint::middle_of`]
    pub fn set_middles(&mut self, middle: impl Fn(T, T) -> T) {
        for joint in Joint::MIDDLES {
            if let Some([left, right]) = joint.middle_of() {
                self[joint] = middle(self[left], self[right]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn each_key_reads_the_value_at_its_place_in_the_order() {
        let joints = PerJoint::new(std::array::from_fn(|i| i));
        let bones = PerBone::new(std::array::from_fn(|i| i));
        assert_eq!(joints[Joint::Nose], 0);
        assert_eq!(joints[Joint::MidHip], 8);
        assert_eq!(joints[Joint::RightHeel], 24);
        assert_eq!(bones[Bone::Root], 0);
        assert_eq!(bones[Bone::LeftUpperArm], 6);
        assert_eq!(bones[Bone::RightFoot], 18);
        assert!(joints.pairs().all(|(joint, &i)| Joint::ALL[i] == joint));
        assert!(bones.pairs().all(|(bone, &i)| Bone::ALL[i] == bone));
    }

    #[test]
    fn from_fn_visits_keys_in_order() {
        let mut seen = Vec::new();
        let bones = PerBone::from_fn(|bone| {
            seen.push(bone);
            bone
        });
        assert_eq!(seen, Bone::ALL);
        assert_eq!(bones.into_array(), Bone::ALL);
        assert_eq!(PerJoint::from_fn(|joint| joint).as_slice(), Joint::ALL);
    }

    #[test]
    fn swapping_all_left_joints_with_right_ones_mirrors() {
        let names = PerJoint::from_fn(Joint::name);
        let mut swapped = names;
        for joint in Joint::ALL.into_iter().filter(|j| *j < j.mirrored()) {
            swapped.swap(joint, joint.mirrored());
        }
        assert_eq!(swapped, PerJoint::from_fn(|joint| names[joint.mirrored()]));
    }

    #[test]
    fn default_and_splat_repeat_one_value() {
        assert_eq!(PerBone::<f64>::default(), PerBone::splat(0.0));
        assert_eq!(PerJoint::splat(7).into_iter().sum::<i32>(), 7 * 25);
    }

    proptest! {
        #[test]
        fn all_ways_to_read_and_write_agree(values: [i32; Bone::COUNT], place in 0..Bone::COUNT) {
            let bone = Bone::ALL[place];
            let mut bones = PerBone::new(values);
            prop_assert_eq!(bones[bone], values[place]);
            prop_assert_eq!(bones.iter().copied().collect::<Vec<_>>(), values);
            prop_assert_eq!((&bones).into_iter().count(), Bone::COUNT);
            prop_assert_eq!(bones, PerBone::from_fn(|b| bones[b]));
            let doubled = bones.map(|v| i64::from(v) * 2);
            prop_assert_eq!(doubled[bone], i64::from(values[place]) * 2);

            bones[bone] = 1;
            prop_assert_eq!(bones.as_slice()[place], 1);
            prop_assert!(bones.pairs().all(|(b, &v)| b == bone || v == values[b as usize]));
            (&mut bones).into_iter().for_each(|value| *value = 2);
            prop_assert_eq!(bones, PerBone::splat(2));
            for (b, value) in bones.pairs_mut() {
                *value = values[b as usize];
            }
            prop_assert_eq!(bones.into_array(), values);
        }
    }
}
