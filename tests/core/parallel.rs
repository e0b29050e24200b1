//! Work on several threads: results in order, the first error, and panics.

use adjsplat::Error;
use adjsplat::internals::in_order;

#[test]
fn results_come_in_order_for_any_number_of_threads() {
    for threads in [1, 2, 3, 8] {
        let mut taken = Vec::new();
        let work = |calls: &mut usize, item: usize| {
            *calls += 1;
            std::thread::sleep(std::time::Duration::from_micros((item * 7 % 5) as u64 * 50));
            Ok(item * item)
        };
        in_order(
            100,
            threads,
            || 0,
            work,
            |item, square| {
                taken.push((item, square));
                Ok(())
            },
        )
        .unwrap();
        assert_eq!(taken, (0..100).map(|item| (item, item * item)).collect::<Vec<_>>());
    }
}

#[test]
fn the_first_error_ends_it() {
    for threads in [1, 4] {
        let mut taken = 0;
        let work = |(): &mut (), item: usize| {
            if item >= 10 { Err(Error::input("item", item.to_string())) } else { Ok(()) }
        };
        let error = in_order(
            1_000,
            threads,
            || (),
            work,
            |_, ()| {
                taken += 1;
                Ok(())
            },
        );
        assert_eq!(error.unwrap_err().to_string(), "item: 10");
        assert_eq!(taken, 10);
    }
}

#[test]
fn what_takes_may_stop_it() {
    let error = in_order(
        1_000,
        4,
        || (),
        |(), item| Ok(item),
        |item, _| {
            if item == 3 { Err(Error::Interrupted) } else { Ok(()) }
        },
    );
    assert!(matches!(error, Err(Error::Interrupted)));
}

#[test]
#[should_panic(expected = "a scoped thread panicked")]
fn a_panic_is_not_waited_for() {
    let _ = in_order(
        100,
        2,
        || (),
        |(), item| {
            assert!(item < 5);
            Ok(())
        },
        |_, ()| Ok(()),
    );
}
