//! Pictures in a stream: portable pixmaps (PPM, `P6`, 8 bits), one after the other.

use std::io::{self, BufRead};

use pirouette::scan::Photo;

/// Largest side of a picture, in px
const MAX_SIDE: usize = 16_384;

/// Reads the next picture; `None` at the end of the stream
///
/// # Errors
/// When the stream ends inside a picture, or is not a pixmap.
pub(super) fn read_ppm(stream: &mut impl BufRead) -> io::Result<Option<Photo>> {
    if stream.fill_buf()?.is_empty() {
        return Ok(None);
    }
    let mut magic = [0; 2];
    stream.read_exact(&mut magic)?;
    if &magic != b"P6" {
        return Err(invalid());
    }
    let width = read_number(stream)?;
    let height = read_number(stream)?;
    let levels = read_number(stream)?;
    let sides = 1..=MAX_SIDE;
    if !sides.contains(&width) || !sides.contains(&height) || levels != 255 {
        return Err(invalid());
    }
    let mut pixels = vec![[0_u8; 3]; width * height];
    stream.read_exact(pixels.as_flattened_mut())?;
    Ok(Some(Photo::from_vec(width, height, pixels)))
}

/// Reads a decimal number after white space, and the one byte of white space that follows it
fn read_number(stream: &mut impl BufRead) -> io::Result<usize> {
    let mut number: Option<usize> = None;
    loop {
        let mut byte = [0];
        stream.read_exact(&mut byte)?;
        match byte[0] {
            digit @ b'0'..=b'9' => {
                let value = number.unwrap_or(0) * 10 + usize::from(digit - b'0');
                if value > MAX_SIDE {
                    return Err(invalid());
                }
                number = Some(value);
            }
            b' ' | b'\t' | b'\n' | b'\r' => {
                if let Some(number) = number {
                    return Ok(number);
                }
            }
            _ => return Err(invalid()),
        }
    }
}

fn invalid() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "not a portable pixmap")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn pictures_follow_each_other() {
        let bytes = b"P6\n2 1\n255\nabcdefP6 1 1 255\nxyz";
        let mut stream = bytes.as_slice();
        let first = read_ppm(&mut stream).unwrap().unwrap();
        assert_eq!((first.width(), first.height()), (2, 1));
        assert_eq!(first[(1, 0)], *b"def");
        assert_eq!(read_ppm(&mut stream).unwrap().unwrap()[(0, 0)], *b"xyz");
        assert!(read_ppm(&mut stream).unwrap().is_none());
    }

    #[test]
    fn a_cut_picture_and_other_formats_are_errors() {
        for bytes in [
            b"P6\n2 1\n255\nabc".as_slice(),
            b"P5\n1 1\n255\na",
            b"P6\n99999 1\n255\n",
            b"P6\n0 1\n255\n",
            b"P6\n1 1\n65535\nabcdef",
            b"P",
        ] {
            assert!(read_ppm(&mut &*bytes).is_err(), "{bytes:?}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_rejected(bytes in proptest::collection::vec(any::<u8>(), 0..80)) {
            let mut stream = [b"P6 ".as_slice(), &bytes].concat();
            let _ = read_ppm(&mut stream.as_slice());
            stream.truncate(2);
            prop_assert!(read_ppm(&mut stream.as_slice()).is_err());
        }
    }
}
