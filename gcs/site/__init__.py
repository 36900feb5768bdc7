"""Several stations that fly one formation: a service over the service of this station."""
