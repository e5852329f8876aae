//! Directories as bytes: their size is known before their place, and their place before they are written.

/// A tag of the directory: number, type, count and value bytes.
pub(crate) struct Tag(pub(crate) u16, pub(crate) u16, pub(crate) u64, pub(crate) Vec<u8>);

impl Tag {
    pub(crate) fn shorts(number: u16, values: &[u16]) -> Self {
        Self(number, 3, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }
    pub(crate) fn long(number: u16, value: u32) -> Self {
        Self(number, 4, 1, value.to_le_bytes().to_vec())
    }
    pub(crate) fn doubles(number: u16, values: &[f64]) -> Self {
        Self(number, 12, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }
    pub(crate) fn text(number: u16, text: &str) -> Self {
        let bytes = [text.as_bytes(), b"\0"].concat();
        Self(number, 2, bytes.len() as u64, bytes)
    }
    /// Offsets or sizes: 64 bits in a BigTIFF, else 32.
    pub(crate) fn places(number: u16, values: impl Iterator<Item = u64>, big: bool) -> Self {
        let mut bytes = Vec::new();
        let mut count = 0;
        for value in values {
            count += 1;
            bytes.extend_from_slice(&value.to_le_bytes()[..if big { 8 } else { 4 }]);
        }
        Self(number, if big { 16 } else { 4 }, count, bytes)
    }
}

/// Bytes of an offset, a count and a value in an entry.
fn field(big: bool) -> usize {
    if big { 8 } else { 4 }
}

fn table_size(num_tags: usize, big: bool) -> u64 {
    if big { 8 + 20 * num_tags as u64 + 8 } else { 2 + 12 * num_tags as u64 + 4 }
}

/// Bytes of a directory with the values that do not fit into it, up to the next multiple of 8.
pub(crate) fn directory_size(tags: &[Tag], big: bool) -> u64 {
    let values = tags.iter().map(|tag| tag.3.len()).filter(|len| *len > field(big));
    let values: u64 = values.map(|len| (len as u64).next_multiple_of(8)).sum();
    table_size(tags.len(), big).next_multiple_of(8) + values
}

/// A directory at `place`, its values behind it.
pub(crate) fn directory_bytes(tags: Vec<Tag>, place: u64, next: u64, big: bool) -> Vec<u8> {
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
