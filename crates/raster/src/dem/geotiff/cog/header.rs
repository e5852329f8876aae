//! The header and the ghost area, in front of the directories.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ghost_area_counts_its_bytes() {
        let (_, rest) = GHOST_AREA.split_once('\n').unwrap();
        assert_eq!(rest.len(), 140);
    }
}
