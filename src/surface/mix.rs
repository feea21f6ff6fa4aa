use super::{Drawn, Incidence, Nature, Reflector, Scattering};
use crate::math::{DVec3, Rgb, Stream};

/// Two materials side by side, too fine to be told apart: f = (1 − w) f_a + w f_b.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Mix {
    /// The one.
    pub a: Reflector,
    /// The other.
    pub b: Reflector,
    /// w, the share of `b`, in \[0, 1\].
    pub weight: f64,
}

impl Mix {
    fn parts(&self) -> [(f64, &Reflector); 2] {
        [(1.0 - self.weight, &self.a), (self.weight, &self.b)]
    }

    pub(super) fn nature(&self) -> Nature {
        let there = self.parts().into_iter().filter(|(share, _)| *share > 0.0);
        there.map(|(_, part)| part.nature()).min().unwrap_or(Nature::Specular)
    }

    pub(super) fn albedo(&self, at: &Incidence) -> Rgb {
        self.parts().into_iter().map(|(share, part)| share * part.albedo(at)).sum()
    }

    /// What both send. Each is drawn with its share as probability, so its parts share with chance by themselves.
    pub(super) fn toward(
        &self,
        at: &Incidence,
        o: DVec3,
        weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        for (share, reflector) in self.parts().into_iter().filter(|(share, _)| *share > 0.0) {
            reflector.toward(at, o, weight, stream, |weight, Scattering { value, ahead }| {
                part(weight, Scattering { value: share * value, ahead: share * ahead });
            });
        }
    }

    /// A draw from one of them.
    pub(super) fn sample(&self, at: &Incidence, stream: &mut Stream) -> Option<Drawn> {
        let [(_, a), (share, b)] = self.parts();
        let (chance, reflector) = if stream.uniform() < share { (share, b) } else { (1.0 - share, a) };
        reflector.sample(at, stream).map(|drawn| Drawn { density: chance * drawn.density, ..drawn })
    }
}
