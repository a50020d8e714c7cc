"""Drive, identify, name, learn anew, swap: a vehicle and a server that teach each other."""
