//! The header, the ghost area and the directories, whose places are known before any of them is written.

use super::super::write::Tag;

/// What GDAL looks for behind the header: that tiles are in order, each between its size and a repeat of its last bytes,
/// so that a tile is read with one request. The number counts the bytes after the first line.
pub(super) const GHOST_AREA: &str = "GDAL_STRUCTURAL_METADATA_SIZE=000140 bytes\nLAYOUT=IFDS_BEFORE_DATA\n\
    BLOCK_ORDER=ROW_MAJOR\nBLOCK_LEADER=SIZE_AS_UINT4\nBLOCK_TRAILER=LAST_4_BYTES_REPEATED\n\
    KNOWN_INCOMPATIBLE_EDITION=NO\n ";

/// The header, with the place of the first directory.
pub(super) fn header(big: bool) -> Vec<u8> {
    let place = first_place(big);
    let mut bytes = b"II".to_vec();
    if big {
        bytes.extend([43, 0, 8, 0, 0, 0]);
        bytes.extend(place.to_le_bytes());
    } else {
        bytes.extend([42, 0]);
        bytes.extend((place as u32).to_le_bytes());
    }
    bytes
}

/// Where the first directory lies: behind header and ghost area, at an even place.
pub(super) fn first_place(big: bool) -> u64 {
    let header = if big { 16 } else { 8 };
    (header + GHOST_AREA.len() as u64).next_multiple_of(8)
}

/// Bytes of an offset, a count and a value in an entry.
fn field(big: bool) -> usize {
    if big { 8 } else { 4 }
}

fn table_size(num_tags: usize, big: bool) -> u64 {
    if big { 8 + 20 * num_tags as u64 + 8 } else { 2 + 12 * num_tags as u64 + 4 }
}

/// Bytes of a directory with the values that do not fit into it, up to the next multiple of 8.
pub(super) fn directory_size(tags: &[Tag], big: bool) -> u64 {
    let values = tags.iter().map(|tag| tag.3.len()).filter(|len| *len > field(big));
    let values: u64 = values.map(|len| (len as u64).next_multiple_of(8)).sum();
    table_size(tags.len(), big).next_multiple_of(8) + values
}

/// A directory at `place`, its values behind it.
pub(super) fn directory_bytes(tags: Vec<Tag>, place: u64, next: u64, big: bool) -> Vec<u8> {
    let field = field(big);
    let number = |value: u64| value.to_le_bytes()[..field].to_vec();
    let size = directory_size(&tags, big) as usize;
    let mut bytes = (tags.len() as u64).to_le_bytes()[..if big { 8 } else { 2 }].to_vec();
    let mut values = Vec::new();
    let values_place = place + table_size(tags.len(), big).next_multiple_of(8);
    for Tag(tag, kind, count, mut value) in tags {
        if value.len() <= field {
            value.resize(field, 0);
        } else {
            let at = number(values_place + values.len() as u64);
            values.extend(value);
            values.resize(values.len().next_multiple_of(8), 0);
            value = at;
        }
        bytes.extend([&tag.to_le_bytes()[..], &kind.to_le_bytes(), &number(count), &value].concat());
    }
    bytes.extend(number(next));
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes.extend(values);
    debug_assert_eq!(bytes.len(), size);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ghost_area_counts_its_bytes() {
        let (_, rest) = GHOST_AREA.split_once('\n').unwrap();
        assert_eq!(rest.len(), 140);
    }
}
