//! A 5×7 pixel font for labels in pictures: capitals, digits and a few signs. Drawn for this project.

use selenograph_raster::Raster;

/// Pixels from one character to the next.
pub const ADVANCE_PX: usize = 6;
/// Height of a line of text, with one empty row below it.
pub const LINE_PX: usize = 8;

/// Each glyph as seven rows from the top, five pixels each, the leftmost in the highest of five bits.
const GLYPHS: [(char, [u8; 7]); 48] = [
    ('A', [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001]),
    ('B', [0b11110, 0b10001, 0b10001, 0b11110, 0b10001, 0b10001, 0b11110]),
    ('C', [0b01110, 0b10001, 0b10000, 0b10000, 0b10000, 0b10001, 0b01110]),
    ('D', [0b11110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b11110]),
    ('E', [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111]),
    ('F', [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000]),
    ('G', [0b01110, 0b10001, 0b10000, 0b10111, 0b10001, 0b10001, 0b01111]),
    ('H', [0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001]),
    ('I', [0b01110, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110]),
    ('J', [0b00111, 0b00010, 0b00010, 0b00010, 0b00010, 0b10010, 0b01100]),
    ('K', [0b10001, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b10001]),
    ('L', [0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b11111]),
    ('M', [0b10001, 0b11011, 0b10101, 0b10101, 0b10001, 0b10001, 0b10001]),
    ('N', [0b10001, 0b11001, 0b10101, 0b10011, 0b10001, 0b10001, 0b10001]),
    ('O', [0b01110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110]),
    ('P', [0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000, 0b10000]),
    ('Q', [0b01110, 0b10001, 0b10001, 0b10001, 0b10101, 0b10010, 0b01101]),
    ('R', [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001]),
    ('S', [0b01111, 0b10000, 0b10000, 0b01110, 0b00001, 0b00001, 0b11110]),
    ('T', [0b11111, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100]),
    ('U', [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110]),
    ('V', [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01010, 0b00100]),
    ('W', [0b10001, 0b10001, 0b10001, 0b10101, 0b10101, 0b11011, 0b10001]),
    ('X', [0b10001, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001, 0b10001]),
    ('Y', [0b10001, 0b10001, 0b01010, 0b00100, 0b00100, 0b00100, 0b00100]),
    ('Z', [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111]),
    ('0', [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110]),
    ('1', [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110]),
    ('2', [0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111]),
    ('3', [0b11110, 0b00001, 0b00001, 0b01110, 0b00001, 0b00001, 0b11110]),
    ('4', [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010]),
    ('5', [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110]),
    ('6', [0b01110, 0b10000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110]),
    ('7', [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b01000, 0b01000]),
    ('8', [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110]),
    ('9', [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00001, 0b01110]),
    ('.', [0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b01100, 0b01100]),
    (',', [0b00000, 0b00000, 0b00000, 0b00000, 0b01100, 0b00100, 0b01000]),
    (':', [0b00000, 0b01100, 0b01100, 0b00000, 0b01100, 0b01100, 0b00000]),
    ('-', [0b00000, 0b00000, 0b00000, 0b11111, 0b00000, 0b00000, 0b00000]),
    ('+', [0b00000, 0b00100, 0b00100, 0b11111, 0b00100, 0b00100, 0b00000]),
    ('/', [0b00001, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b10000]),
    ('%', [0b11001, 0b11001, 0b00010, 0b00100, 0b01000, 0b10011, 0b10011]),
    ('°', [0b01100, 0b10010, 0b01100, 0b00000, 0b00000, 0b00000, 0b00000]),
    ('(', [0b00010, 0b00100, 0b01000, 0b01000, 0b01000, 0b00100, 0b00010]),
    (')', [0b01000, 0b00100, 0b00010, 0b00010, 0b00010, 0b00100, 0b01000]),
    ('=', [0b00000, 0b00000, 0b11111, 0b00000, 0b11111, 0b00000, 0b00000]),
    ('_', [0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b11111]),
];

/// A filled box stands for a sign that the font does not have.
const UNKNOWN: [u8; 7] = [0b11111; 7];

/// Writes a line of text with its upper left corner at (x, y), each pixel of the font a square of `zoom`; what leaves the picture is
/// cut off.
pub fn write(picture: &mut Raster<[u8; 3]>, [x, y]: [usize; 2], text: &str, zoom: usize, color: [u8; 3]) {
    for (idx, sign) in text.chars().enumerate() {
        let Some(rows) = rows_of(sign) else { continue };
        for (dy, bits) in rows.iter().enumerate() {
            for dx in (0..5).filter(|dx| bits >> (4 - dx) & 1 == 1) {
                let [left, top] = [x + zoom * (idx * ADVANCE_PX + dx), y + zoom * dy];
                for py in top..(top + zoom).min(picture.height) {
                    for px in left..(left + zoom).min(picture.width) {
                        picture[(px, py)] = color;
                    }
                }
            }
        }
    }
}

/// `None` for a blank.
fn rows_of(sign: char) -> Option<[u8; 7]> {
    if sign == ' ' {
        return None;
    }
    let capital = sign.to_ascii_uppercase();
    Some(GLYPHS.iter().find(|(glyph, _)| *glyph == capital).map_or(UNKNOWN, |(_, rows)| *rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_drawn_and_cut_off() {
        let mut picture = Raster::filled(8, 7, [0; 3]);
        write(&mut picture, [0, 0], "l1", 1, [9; 3]);
        let row =
            |y: usize| picture.row(y).iter().map(|p| if p[0] > 0 { '#' } else { '.' }).collect::<String>();
        assert_eq!(row(0), "#.......");
        assert_eq!(row(1), "#......#");
        assert_eq!(row(6), "#####..#");
        write(&mut picture, [7, 6], "WWW", 1, [9; 3]);
        let mut large = Raster::filled(12, 14, [0; 3]);
        write(&mut large, [0, 0], "1", 2, [9; 3]);
        let count = |picture: &Raster<[u8; 3]>| picture.data.iter().filter(|p| p[0] > 0).count();
        let mut small = Raster::filled(6, 7, [0; 3]);
        write(&mut small, [0, 0], "1", 1, [9; 3]);
        assert_eq!(count(&large), 4 * count(&small));
    }

    #[test]
    fn glyphs_are_five_wide_and_different() {
        for (i, (sign, rows)) in GLYPHS.iter().enumerate() {
            assert!(rows.iter().all(|bits| *bits < 32), "{sign}");
            assert!(GLYPHS[..i].iter().all(|(other, seen)| seen != rows && other != sign), "{sign}");
        }
    }
}
