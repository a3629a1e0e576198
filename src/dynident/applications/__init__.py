"""What uses an identified model: payload, drive gains, collision monitor, tracking, fleet, compensation."""
