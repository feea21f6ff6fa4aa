//! Limits of the events between light and eye.

/// How many events a path may have between light and eye: scatterings in media and at surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Events {
    /// [`Events::ENDLESS`] where nothing limits them.
    most: u64,
}

impl Events {
    /// More than any walk has.
    const ENDLESS: u64 = u64::MAX;

    /// No limit: as many as come.
    pub const fn unlimited() -> Self {
        Events { most: Self::ENDLESS }
    }

    /// No more than `most`.
    pub const fn at_most(most: u64) -> Self {
        Events { most }
    }

    /// What a scene file says by `render.max_depth`, where 0 stands for no limit.
    pub const fn of_max_depth(max_depth: u32) -> Self {
        if max_depth == 0 { Self::unlimited() } else { Self::at_most(max_depth as u64) }
    }

    /// Whether there is a limit.
    pub const fn is_limited(self) -> bool {
        self.most != Self::ENDLESS
    }

    /// Whether a path of so many events may have one more.
    #[inline(always)]
    pub const fn allows(self, events: u64) -> bool {
        events < self.most
    }

    /// How many more a path of so many events may have; `None` where these are more than are allowed.
    #[inline(always)]
    pub const fn left_after(self, events: u64) -> Option<Events> {
        match self.most {
            Self::ENDLESS => Some(self),
            most => match most.checked_sub(events) {
                Some(left) => Some(Events { most: left }),
                None => None,
            },
        }
    }

    /// The limit as photons remember their events: 255 stands for all beyond.
    #[inline(always)]
    pub const fn in_a_byte(self) -> u8 {
        if self.most < 255 { self.most as u8 } else { 255 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_counts_down_to_none() {
        let three = Events::of_max_depth(3);
        assert_eq!(three, Events::at_most(3));
        assert!(three.is_limited() && three.allows(2) && !three.allows(3));
        assert_eq!(three.left_after(3), Some(Events::at_most(0)));
        assert_eq!(three.left_after(4), None);
        assert_eq!(Events::at_most(0).in_a_byte(), 0);
        assert_eq!(Events::at_most(1000).in_a_byte(), 255);

        let all = Events::of_max_depth(0);
        assert!(!all.is_limited() && all.allows(u64::MAX - 1));
        assert_eq!((all.left_after(1 << 40), all.in_a_byte()), (Some(all), 255));
    }
}
