//! Whether two sets of sources look at the same ground.

use super::source::{Kind, Source};
use crate::Error;
use crate::pair::ViewName;
use crate::split::{Bounds, Footprint, map_for, map_of, share_ground};
use selenograph_geometry::Projection;

/// Pairs of a campaign that are looked at: it may hold millions.
const MAX_FLIGHTS: u64 = 256;

/// Two pairs that see the same ground.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SharedGround {
    /// Source and number of the one that is trained on.
    pub train: (String, u64),
    /// Source and number of the one that is validated on.
    pub val: (String, u64),
}

/// Pairs of the first sources that see ground of pairs of the second, one row for each of the second that is seen. Sources
/// of different [`Source::world`]s share none; of a campaign, some 256 pairs are looked at.
///
/// # Errors
/// Those of reading depths and cameras.
pub fn shared_ground(train: &[Source], val: &[Source]) -> Result<Vec<SharedGround>, Error> {
    let mut found = Vec::new();
    for val in val {
        let Some(map) = val.map()? else { continue };
        let ground = val.footprints(&map)?;
        for train in train.iter().filter(|train| train.world == val.world) {
            let own = train.footprints(&map)?;
            for seen in &ground {
                if let Some(other) = own.iter().find(|other| share_ground(seen, other)) {
                    found.push(SharedGround {
                        train: (train.name.clone(), other.pair_id),
                        val: (val.name.clone(), seen.pair_id),
                    });
                }
            }
        }
    }
    Ok(found)
}

impl Source {
    /// Keeps a campaign away from the ground of other sources of its world: pairs that would see it are replaced. Sources of
    /// stored pairs are left as they are.
    ///
    /// # Errors
    /// Those of reading depths and cameras.
    pub fn keep_off(&mut self, others: &[Self]) -> Result<(), Error> {
        let Kind::Flight(flight) = &mut self.kind else { return Ok(()) };
        let mut ground = Vec::new();
        let mut map = None;
        for other in others.iter().filter(|other| other.world == self.world) {
            let Some(first) = other.map()? else { continue };
            let map = map.get_or_insert(first);
            ground.extend(other.footprints(map)?);
        }
        if let Some(map) = map {
            flight.keep_out(map, ground);
        }
        Ok(())
    }

    /// A map near the source's ground.
    fn map(&self) -> Result<Option<Projection>, Error> {
        Ok(match &self.kind {
            Kind::Stored(pairs) => match pairs.first() {
                Some((_, pair)) => Some(map_of(&pair.open()?)?),
                None => None,
            },
            Kind::Flight(flight) => flight.site_latitude_deg()?.map(|lat| map_for(&flight.terrain.body, lat)),
        })
    }

    /// The ground of its pairs that have depth.
    fn footprints(&self, map: &Projection) -> Result<Vec<Footprint>, Error> {
        let mut found = Vec::new();
        match &self.kind {
            Kind::Stored(pairs) => {
                for (pair_id, stored) in pairs {
                    let pair = stored.open()?;
                    let mut bounds = Bounds::default();
                    for view in ViewName::BOTH.into_iter().filter(|view| stored.has_depth(*view)) {
                        bounds.add_view(&pair.raw_view(view)?, map)?;
                    }
                    found.extend(bounds.footprint(*pair_id));
                }
            }
            Kind::Flight(flight) => {
                // Spread over all sections: numbers run through one after the other.
                let count = flight.num_pairs().min(MAX_FLIGHTS);
                for n in 0..count {
                    found.extend(flight.footprint(n * flight.num_pairs() / count, map)?);
                }
            }
        }
        Ok(found)
    }
}
