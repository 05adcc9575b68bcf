//! Morton order.
