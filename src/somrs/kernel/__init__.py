"""The foundation of all components: their interface, their pending effects and recovery, and a replica of the map."""
