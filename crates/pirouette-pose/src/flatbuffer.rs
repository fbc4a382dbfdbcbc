//! Reading FlatBuffers: every access is checked against the length of the file.
//!
//! Values are read at any alignment. Tables and vectors may overlap or contain each other; readers must therefore
//! limit how many they follow. Nothing is allocated before its size is known to fit in the file.
//!
//! # Source
//! FlatBuffers, "Internals", <https://flatbuffers.dev/internals/>

use crate::ModelError;

/// Table of a FlatBuffer: fields by slot number
#[derive(Clone, Copy, Debug)]
pub(crate) struct Table<'a> {
    bytes: &'a [u8],
    at: usize,
    vtable: usize,
    vtable_len: usize,
}

/// Offsets of the fields `length` and the first item of a vector, and its length
struct Vector {
    start: usize,
    len: usize,
}

impl<'a> Table<'a> {
    /// Reads the root table of a file.
    pub(crate) fn root(bytes: &'a [u8]) -> Result<Self, ModelError> {
        Self::at_offset(bytes, 0)
    }

    /// Reads the table that the offset at `place` refers to.
    fn at_offset(bytes: &'a [u8], place: usize) -> Result<Self, ModelError> {
        let at = target(bytes, place)?;
        let back = i64::from(i32::from_le_bytes(array(bytes, at)?));
        let vtable = at as i64 - back;
        let vtable = usize::try_from(vtable)
            .ok()
            .ok_or(ModelError::Damaged { offset: at })?;
        let vtable_len = usize::from(u16::from_le_bytes(array(bytes, vtable)?));
        Ok(Self {
            bytes,
            at,
            vtable,
            vtable_len,
        })
    }

    /// Returns the place of a field's value, `None` if the table does not contain it.
    fn field(&self, slot: usize) -> Result<Option<usize>, ModelError> {
        let entry = 4 + 2 * slot;
        if entry + 2 > self.vtable_len {
            return Ok(None);
        }
        let offset = usize::from(u16::from_le_bytes(array(self.bytes, self.vtable + entry)?));
        Ok((offset != 0).then_some(self.at + offset))
    }

    /// Reads a byte, or returns `default` if the table does not contain it.
    pub(crate) fn u8(&self, slot: usize, default: u8) -> Result<u8, ModelError> {
        let Some(at) = self.field(slot)? else {
            return Ok(default);
        };
        Ok(array::<1>(self.bytes, at)?[0])
    }

    /// Reads a 32-bit integer, or returns `default` if the table does not contain it.
    pub(crate) fn i32(&self, slot: usize, default: i32) -> Result<i32, ModelError> {
        let Some(at) = self.field(slot)? else {
            return Ok(default);
        };
        Ok(i32::from_le_bytes(array(self.bytes, at)?))
    }

    /// Reads a table.
    pub(crate) fn table(&self, slot: usize) -> Result<Option<Self>, ModelError> {
        self.field(slot)?
            .map(|at| Self::at_offset(self.bytes, at))
            .transpose()
    }

    /// Checks that a vector of items of `item_len` bytes lies inside the file.
    fn vector(&self, slot: usize, item_len: usize) -> Result<Vector, ModelError> {
        let Some(at) = self.field(slot)? else {
            return Ok(Vector { start: 0, len: 0 });
        };
        let start = target(self.bytes, at)?;
        let len = u32::from_le_bytes(array(self.bytes, start)?) as usize;
        let available = self.bytes.len() - (start + 4);
        if len > available / item_len {
            return Err(ModelError::Damaged { offset: start });
        }
        Ok(Vector {
            start: start + 4,
            len,
        })
    }

    /// Reads a vector of bytes; empty if the table does not contain it.
    pub(crate) fn bytes(&self, slot: usize) -> Result<&'a [u8], ModelError> {
        let Vector { start, len } = self.vector(slot, 1)?;
        Ok(&self.bytes[start..start + len])
    }

    /// Reads a vector of at most `limit` integers; empty if the table does not contain it.
    pub(crate) fn i32s(
        &self,
        slot: usize,
        what: &'static str,
        limit: usize,
    ) -> Result<Vec<i32>, ModelError> {
        let Vector { start, len } = self.vector(slot, 4)?;
        check_limit(what, len, limit)?;
        (0..len)
            .map(|i| Ok(i32::from_le_bytes(array(self.bytes, start + 4 * i)?)))
            .collect()
    }

    /// Reads a vector of at most `limit` tables; empty if the table does not contain it.
    pub(crate) fn tables(
        &self,
        slot: usize,
        what: &'static str,
        limit: usize,
    ) -> Result<Vec<Self>, ModelError> {
        let Vector { start, len } = self.vector(slot, 4)?;
        check_limit(what, len, limit)?;
        (0..len)
            .map(|i| Self::at_offset(self.bytes, start + 4 * i))
            .collect()
    }
}

/// Returns an error if `found` is above `limit`.
pub(crate) fn check_limit(
    what: &'static str,
    found: usize,
    limit: usize,
) -> Result<(), ModelError> {
    if found > limit {
        Err(ModelError::TooLarge { what, found, limit })
    } else {
        Ok(())
    }
}

/// Reads `N` bytes.
fn array<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], ModelError> {
    bytes
        .get(at..)
        .and_then(|rest| rest.first_chunk::<N>())
        .copied()
        .ok_or(ModelError::Damaged { offset: at })
}

/// Follows the offset at `place`; the result is below 2^32 plus the length of the file.
fn target(bytes: &[u8], place: usize) -> Result<usize, ModelError> {
    let offset = u32::from_le_bytes(array(bytes, place)?) as usize;
    place
        .checked_add(offset)
        .filter(|&at| at < bytes.len())
        .ok_or(ModelError::Damaged { offset: place })
}
