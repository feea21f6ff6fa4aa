//! Which instruction set kernels run in: found once, at run time.

use super::Task;
#[cfg(not(target_arch = "x86_64"))]
use super::portable::Portable;
#[cfg(target_arch = "x86_64")]
use super::x86;

/// An instruction set that this machine has, and that kernels are compiled for. [`Isa::available`] alone makes one, and
/// looks for what it needs: that it exists proves that its instructions may be executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Isa(Set);

/// The instruction sets that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Set {
    /// AVX-512 F, BW, DQ and VL.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// AVX2 and FMA, with POPCNT and BMI1, which came before them.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// Whatever the crate was compiled for.
    Portable,
}

impl Isa {
    /// Every instruction set this machine has, the fastest first.
    pub(crate) fn available() -> Vec<Isa> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("fma")
                && is_x86_feature_detected!("popcnt")
                && is_x86_feature_detected!("bmi1");
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if avx2 && avx512 {
                sets.push(Isa(Set::Avx512));
            }
            if avx2 {
                sets.push(Isa(Set::Avx2));
            }
        }
        sets.push(Isa(Set::Portable));
        sets
    }

    /// The fastest instruction set this machine has.
    pub(crate) fn best() -> Isa {
        Self::available()[0]
    }

    /// What it is called.
    pub(crate) fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "AVX2",
            Set::Portable => "portable",
        }
    }

    /// Runs `task` with this set's lanes.
    pub(crate) fn run<T: Task>(self, task: T) -> T::Output {
        self.run_or(task, |task| task)
    }

    /// Runs `task`, or, where there are portable lanes only, what `general` makes of it: a task that looks at run time for
    /// what others are compiled for, so that what is seldom needed is compiled once.
    pub(crate) fn run_or<T: Task, G: Task<Output = T::Output>>(
        self,
        task: T,
        general: impl FnOnce(T) -> G,
    ) -> T::Output {
        match self.0 {
            // SAFETY: `available` alone makes values of this variant, where it found the features.
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => unsafe { run_avx512(task) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => unsafe { run_avx2(task) },
            #[cfg(target_arch = "x86_64")]
            Set::Portable => general(task).run::<x86::Sse2>(),
            #[cfg(not(target_arch = "x86_64"))]
            Set::Portable => general(task).run::<Portable>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,popcnt,bmi1")]
fn run_avx512<T: Task>(task: T) -> T::Output {
    task.run::<x86::Avx512>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,popcnt,bmi1")]
fn run_avx2<T: Task>(task: T) -> T::Output {
    task.run::<x86::Avx2>()
}
