// The states of users and drones; the words for users are part of the page's data.

export const IDLE = 0;
export const ATTACHED = 1;
export const WAITING = 2;
export const SERVED = 3;

export const FLYING = 0;
export const RETURNING = 1;
export const QUEUED = 2;
export const CHARGING = 3;
export const CHARGED = 4;
export const CRASHED = 5;
