"""Everything that steps time: simulator, environments, referee, hand controllers, recorded traces."""
