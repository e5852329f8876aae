//! What a file of some length may ask for: sizes are judged before memory is taken for them.

use crate::Error;
use std::path::Path;

/// Memory that the samples of any file may take, however short it is.
const ALWAYS_BYTES: u64 = 64 << 20;

/// Bytes that one byte of a file can become: LZW reaches 1400, deflate 1032, JPEG 400.
const MAX_EXPANSION: u64 = 2048;

/// Refuses `bytes` of samples (`None` past 2⁶⁴) that a file of `length` bytes cannot hold in any compression.
pub(crate) fn check(path: &Path, what: &str, bytes: Option<u64>, length: u64) -> Result<(), Error> {
    let most = length.saturating_mul(MAX_EXPANSION).max(ALWAYS_BYTES);
    if bytes.is_some_and(|bytes| bytes <= most) {
        return Ok(());
    }
    Err(Error::Malformed {
        path: path.to_owned(),
        what: what.to_owned(),
        expected: format!("at most {most} bytes of samples in a file of {length} bytes"),
        found: bytes.map_or_else(|| "more than 2⁶⁴".to_owned(), |bytes| bytes.to_string()),
    })
}

/// The product of sizes.
pub(crate) fn product(sizes: &[u64]) -> Option<u64> {
    sizes.iter().try_fold(1u64, |product, size| product.checked_mul(*size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_files_hold_little() {
        let path = Path::new("x");
        assert!(check(path, "size", product(&[4096, 4096, 4]), 10).is_ok());
        assert!(check(path, "size", product(&[500_000_000, 4]), 446).is_err());
        assert!(check(path, "size", product(&[500_000_000, 4]), 1 << 20).is_ok());
        assert!(check(path, "size", product(&[1 << 40, 1 << 40]), u64::MAX).is_err());
    }
}
