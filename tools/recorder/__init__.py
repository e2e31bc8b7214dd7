"""Records a cart: a client of the service's feed that writes black boxes. The service does not need it."""
