//! Pairs as they are stored, ours and the paper's triplets: the one place that lists them and reads them.
//!
//! | you want to | open |
//! | --- | --- |
//! | know which pairs a folder holds | [`find`], [`own`], [`of_split`]: a list of [`StoredPair`]s, nothing of them read yet |
//! | read of one what you need | [`StoredPair::open`], then [`OpenPair`]: pictures, depth, cameras, its record |
//! | know the Sun of a picture that lies in a pair | [`sun_of_picture`] |
//! | hold pairs in another way than in folders | [`Place`]: names of files become bytes there only |

mod list;
mod open;
mod own;
mod place;
mod split_table;
mod sun;
pub(crate) mod triplets;
mod view;

pub use list::{find, of_split, own};
pub use open::{Layout, OpenPair, ReadOptions, StoredPair};
pub use place::Place;
pub use split_table::{SplitTable, encode_split, read_split};
pub use sun::{PictureSun, sun_of_picture};
pub use triplets::{Triplet, TripletPair};
pub use view::{RawView, StereoPair, StereoView};
pub(crate) use view::{grey8, nearest_rotation};

#[cfg(test)]
mod tests;
