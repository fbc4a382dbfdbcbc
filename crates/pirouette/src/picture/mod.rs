//! Pictures that show at a glance what went wrong where.
